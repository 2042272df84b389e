#include "palpate/stability/hold.h"

#include <algorithm>
#include <cmath>

#include "palpate/device/workspace.h"
#include "palpate/servo/servo.h"
#include "stability/buzz.h"

namespace palpate {
namespace {

constexpr double kUserLimit_N = 3;
constexpr int kTicksBetweenChecks = 1000;

std::optional<Error> fault_of(const Hold& hold) {
  // written such that NaN is out of range
  if (!(hold.rate_hz >= kLowestHold_hz && hold.rate_hz <= kHighestHold_hz))
    return Error{ErrorKind::kBadInput, "holding cannot be simulated at this rate", "",
                 "choose from 250 to 10000 Hz"};
  if (!(hold.delay_s >= 0 && hold.delay_s <= SimulatedDevice::kMaxDelay_s))
    return Error{ErrorKind::kBadInput, "holding cannot be simulated with this delay", "",
                 "choose from 0 to 20 ms"};
  return std::nullopt;
}

/// Closed loop of hand, device and servo.
class Loop {
 public:
  Loop(const Model& model, const Hold& hold)
      : model_(model),
        dt_s_(1 / hold.rate_hz),
        plant_(hold.device, hold.hand, hold.delay_s),
        mapping_(plant_.info(), workspace_of(hold)) {
    parameters_.method = hold.method;
    parameters_.max_force_N = std::min(hold.device.continuous_force_N, kUserLimit_N);
    parameters_.device[0] = device_parameters(plant_.info(), workspace_of(hold));
    plant_.reset(on_device(hold.from));
  }

  Point<Device> on_device(const Point<Patient>& at) const {
    return mapping_.to_device(model_.X_WorldPatient * at);
  }

  /// Runs a tick and returns the commanded force.
  Vector<Device> tick_once(const Point<Patient>& requested) {
    const DeviceState sensed = mapping_.to_world(plant_.read(), 0);
    tick(model_, parameters_, {&sensed, 1}, dt_s_, state_, {&sent_, 1}, record_);
    const DeviceCommand command = mapping_.to_device(sent_);
    plant_.intend(on_device(requested));
    plant_.advance(command, dt_s_);
    return command.force_N;
  }

  const SimulatedDevice& plant() const { return plant_; }
  std::uint32_t flags() const { return record_.device[0].flags; }  ///< Flags of the last tick

 private:
  static WorkspaceSettings workspace_of(const Hold& hold) {
    WorkspaceSettings workspace;
    workspace.force_gain = hold.force_gain;
    return workspace;
  }

  const Model& model_;
  double dt_s_;
  SimulatedDevice plant_;
  WorkspaceMapping mapping_;
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  Wrench sent_;
};

// Force acting in each of the last `count` ticks: a command acts after its delay, which may end within a
// tick.
std::vector<Eigen::Vector3d> acted(const std::vector<Eigen::Vector3d>& sent_N, std::size_t count,
                                   double delay_ticks) {
  const auto whole = static_cast<std::size_t>(delay_ticks);
  const double part = delay_ticks - static_cast<double>(whole);
  const auto sent_before = [&](std::size_t tick, std::size_t ticks) -> Eigen::Vector3d {
    return tick >= ticks ? sent_N[tick - ticks] : Eigen::Vector3d::Zero();
  };
  std::vector<Eigen::Vector3d> acting;
  for (std::size_t n = sent_N.size() - count; n < sent_N.size(); ++n)
    acting.push_back((1 - part) * sent_before(n, whole) + part * sent_before(n, whole + 1));
  return acting;
}

}  // namespace

Result<HoldResult> hold_tip(const Model& model, const Hold& hold, const Progress& progress) {
  if (const auto fault = fault_of(hold)) return *fault;
  PALPATE_CHECK(model.has(hold.method));
  Loop loop(model, hold);
  HoldResult result{hold.method, {}, 1e6 * hold.device.encoder_step_m, false, false, hold.rate_hz, {}};
  const long lead = std::lround(kHoldApproach_s * hold.rate_hz),
             rest = std::lround(kHoldDuration_s * hold.rate_hz);
  const auto X_PatientWorld = model.X_WorldPatient.inverse();
  const Point<Device> zero = loop.on_device(hold.at);

  // relative to the rest position of the hand, in the device's axes
  std::vector<Eigen::Vector3d> tip_mm, sent_N;
  for (long n = 0; n < lead + rest; ++n) {
    if (n % kTicksBetweenChecks == 0 && progress.stopped()) return Progress::interrupted();
    if (n >= lead) tip_mm.push_back((loop.plant().true_tip() - zero).eigen());
    const double distance = std::min(1.0, static_cast<double>(n + 1) / static_cast<double>(lead));
    sent_N.push_back(loop.tick_once(hold.from + distance * (hold.at - hold.from)).eigen());
  }
  tip_mm.push_back((loop.plant().true_tip() - zero).eigen());
  result.inside = (loop.flags() & kFlagInside) != 0;
  result.wedged = (loop.flags() & kFlagWedged) != 0;

  const auto second = static_cast<std::size_t>(std::lround(hold.rate_hz));
  result.buzz = buzz_of(std::span(tip_mm).last(second + 1),
                        acted(sent_N, second, hold.delay_s * hold.rate_hz), hold.rate_hz);
  // a simulated device's axes are World's
  for (const Eigen::Vector3d& tip : tip_mm)
    result.tip.push_back(hold.at + X_PatientWorld * Vector<World>(tip));
  return result;
}

}  // namespace palpate
