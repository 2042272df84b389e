#include "session/hand_thread.h"

#include <algorithm>
#include <chrono>
#include <system_error>

#include "palpate/base/clock.h"
#include "palpate/palpation/logged_loop.h"

namespace palpate {
namespace {

constexpr std::chrono::nanoseconds kHandPeriod = std::chrono::milliseconds(2);
// time to reach an intention: longer than the period, so that the next one arrives before the hand comes to
// rest
constexpr std::int64_t kLead_ns = 2 * kHandPeriod.count();
// upper bound of a step: a hand whose thread was delayed longer continues from where it was
constexpr double kMaxStep_s = 0.02;
constexpr std::uint32_t kForceIsOff = kFaultFlags | kFlagRamp | kFlagStale;
constexpr double kLeaving_mm_s = 50, kComingBack_mm_s = 20;
// more than the amplitude of the tremor
constexpr double kAwayFromAll_mm = 3;

}  // namespace

HandThread::HandThread(ScriptedHand hand, const WorkspaceSettings& workspace, SimulatedDriver& driver,
                       ServoLoop& loop, EventLog& log, ScriptEdits edits, bool repeat)
    : hand_(std::move(hand)),
      mapping_(driver.devices()[0], workspace),
      driver_(driver),
      loop_(loop),
      log_(log),
      edits_(std::move(edits)),
      repeat_(repeat) {}

Result<void> HandThread::begin() try {
  thread_ = std::thread([this] { run(); });
  return {};
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable,
               std::string("cannot start the thread of the simulated hand: ") + error.what(), "",
               "close other programs, or raise the process limit (ulimit -u)"};
}

void HandThread::end() {
  end_.store(true);
  if (thread_.joinable()) thread_.join();
}

void HandThread::run() {
  auto next = std::chrono::steady_clock::now();
  std::int64_t last_ns = monotonic_ns();
  while (!end_.load() && !done_.load()) {
    next = std::max(next + kHandPeriod, std::chrono::steady_clock::now());
    std::this_thread::sleep_until(next);
    const std::int64_t now_ns = monotonic_ns();
    move(std::min(static_cast<double>(now_ns - last_ns) * 1e-9, kMaxStep_s));
    last_ns = now_ns;
  }
}

void HandThread::move(double dt_s) {
  const TickRecord tick = loop_.snapshot();
  const DeviceTick& device = tick.device[0];
  const bool no_tick_yet = tick.dt_s == 0;
  if (no_tick_yet) return;
  if ((device.flags & kFlagEmergencyStop) != 0) return withdraw(device, dt_s);
  if ((device.flags & kForceIsOff) != 0 || !return_to_path(dt_s)) return;
  const Vector<World> force_N(device.force_N[0], device.force_N[1], device.force_N[2]);
  if (force_N.norm() > 0) outward_ = force_N.normalized();

  // viewers may have rotated the object
  const Eigen::Quaterniond rotation_target = loop_.parameters().rotation_target;
  HandCommands commands{rotation_target, {}, {}, {}, {}, edits_.stroke_version(), edits_.law_version()};
  const auto intention = hand_.next(tick, dt_s, commands);
  progress_.store(hand_.progress());
  if (!intention) {
    if (repeat_)
      hand_.begin_again();
    else
      done_.store(true);
    return;
  }
  script_target_ = *intention;
  intend(*intention);
  if (commands.stroke) edits_.change_stroke(*commands.stroke);
  if (commands.law) edits_.change_law(*commands.law);
  const bool turned = commands.rotation_target.coeffs() != rotation_target.coeffs();
  if (!turned && !commands.method && !commands.motor) return;
  change_logged(loop_, log_, {Originator::kScript}, [&](Parameters& parameters) {
    if (turned) parameters.rotation_target = commands.rotation_target;
    if (commands.method) parameters.method = *commands.method;
    if (commands.motor) parameters.motor = *commands.motor;
  });
}

void HandThread::intend(const Point<World>& target) {
  driver_.intend(mapping_.to_device(target), monotonic_ns() + kLead_ns);
}

// moves along the last contact force; the path is not checked, so that it gets out of any contact
void HandThread::withdraw(const DeviceTick& device, double dt_s) {
  if (!script_target_) return;
  if (!withdrawn_target_) {
    withdrawn_target_ = script_target_;
    clear_mm_ = kAwayFromAll_mm;
  }
  if ((device.flags & (kFlagContact | kFlagInside)) != 0) clear_mm_ = 0;
  if (clear_mm_ >= kAwayFromAll_mm) return;
  *withdrawn_target_ += outward_ * (kLeaving_mm_s * dt_s);
  clear_mm_ += kLeaving_mm_s * dt_s;
  intend(*withdrawn_target_);
}

// moves back to where the script was interrupted; returns whether it has arrived
bool HandThread::return_to_path(double dt_s) {
  if (!withdrawn_target_) return true;
  const Vector<World> displacement = *script_target_ - *withdrawn_target_;
  const double step_mm = kComingBack_mm_s * dt_s;
  if (displacement.norm() <= step_mm) {
    withdrawn_target_.reset();
    return true;
  }
  *withdrawn_target_ += displacement.normalized() * step_mm;
  intend(*withdrawn_target_);
  return false;
}

}  // namespace palpate
