#include "verification/stability_following.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "palpate/device/workspace.h"
#include "palpate/servo/servo.h"
#include "palpate/stability/stability.h"
#include "verification/figure_names.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

constexpr double kPressing_s = 4, kChecked_s = 1;
constexpr double kSeparation_mm = 10, kBegin_mm = 1, kDown_mm_s = 100, kRampIn_s = 0.6;
// the follower's period is longer by this factor, so that its updates occur at every phase between two ticks
constexpr double kRunsAway = 1.0007;

/// A hand with its device, the state that it publishes and the command that it receives. Times are on the
/// owner's clock.
class Presser {
 public:
  Presser(const Model& wall, const PressingDevice& pressing, double press_N, double y_mm)
      : wall_(wall),
        y_mm_(y_mm),
        plant_(pressing.device, pressing.hand, pressing.delay_s),
        workspace_(workspace_of(pressing)),
        mapping_(plant_.info(), workspace_),
        hand_mm_(press_N / pressing.stiffness_N_per_mm +
                 (press_N + pressing.device.coulomb_N) / pressing.hand.stiffness_N_per_m * 1e3) {
    plant_.reset(on_device(kBegin_mm));
  }

  DeviceParameters parameters(double delay_s) const {
    DeviceParameters parameters = device_parameters(plant_.info(), workspace_);
    parameters.delay_s = delay_s;
    return parameters;
  }
  /// Advances to a time under the acting force; the hand approaches at 0.1 m/s after the force ramp-in.
  void advance(double to_s) {
    const double down_mm = std::clamp(kDown_mm_s * (to_s - kRampIn_s), 0.0, kBegin_mm + hand_mm_);
    plant_.intend(on_device(kBegin_mm - down_mm));
    plant_.advance(acting_, to_s - now_s_);
    now_s_ = to_s;
  }
  void publish_sample() {
    reported_ = plant_.read();
    reported_s_ = now_s_;
  }
  void act(const Wrench& sent) { acting_ = mapping_.to_device(sent); }
  DeviceState state(double now_s) {
    DeviceState state = mapping_.to_world(reported_, 0);
    state.age_s = now_s - reported_s_;
    return state;
  }
  /// Records the last second.
  void observe(double force_N) {
    const Vector<Device> out = on_device(1) - on_device(0);
    const double height_mm = out.dot(plant_.true_tip() - on_device(0));
    low_mm_ = std::min(low_mm_, height_mm);
    high_mm_ = std::max(high_mm_, height_mm);
    sum_N_ += force_N;
    ++appearances_;
  }
  PressResult result() const { return {high_mm_ - low_mm_, sum_N_ / appearances_}; }

 private:
  static WorkspaceSettings workspace_of(const PressingDevice& pressing) {
    WorkspaceSettings workspace;
    workspace.force_gain = pressing.stiffness_N_per_mm;
    return workspace;
  }
  Point<Device> on_device(double x_mm) const {
    return mapping_.to_device(wall_.X_WorldPatient * Point<Patient>(x_mm, y_mm_, 0));
  }

  const Model& wall_;
  const double y_mm_;
  SimulatedDevice plant_;
  const WorkspaceSettings workspace_;
  WorkspaceMapping mapping_;
  const double hand_mm_;
  DeviceSample reported_;
  DeviceCommand acting_;
  double now_s_ = 0, reported_s_ = 0;
  double low_mm_ = std::numeric_limits<double>::infinity(), high_mm_ = -low_mm_, sum_N_ = 0;
  int appearances_ = 0;
};

Parameters parameters_of(bool controller) {
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  parameters.passivity = controller;
  return parameters;
}

}  // namespace

double following_delay_s(const PressingDevice& owner, const PressingDevice& follower) {
  return follower.delay_s + 1 / follower.rate_hz + 1 / owner.rate_hz;
}

std::array<PressResult, 2> run_following(const Model& wall, const Following& following) {
  const auto& [owner, follower, press_N, controller, is_delay_counted] = following;
  Presser owns(wall, owner, press_N, -kSeparation_mm / 2),
      follows(wall, follower, press_N, kSeparation_mm / 2);
  Parameters parameters = parameters_of(controller);
  parameters.device[0] = owns.parameters(owner.delay_s);
  parameters.device[1] =
      follows.parameters(is_delay_counted ? following_delay_s(owner, follower) : follower.delay_s);

  const double tick_s = 1 / owner.rate_hz, update_s = kRunsAway / follower.rate_hz;
  SessionState state;
  TickRecord record;
  std::array<Wrench, 2> sent;
  long ticks = 0, updates = 0;
  // the follower has published its state before the first tick
  follows.publish_sample();
  while (static_cast<double>(ticks) * tick_s < kPressing_s) {
    const double at_tick_s = static_cast<double>(ticks + 1) * tick_s;
    const double at_update_s = static_cast<double>(updates + 1) * update_s;
    if (at_update_s <= at_tick_s) {
      follows.advance(at_update_s);
      follows.publish_sample();
      follows.act(sent[1]);
      ++updates;
      continue;
    }
    owns.advance(at_tick_s);
    owns.publish_sample();
    const std::array sensed{owns.state(at_tick_s), follows.state(at_tick_s)};
    tick(wall, parameters, sensed, tick_s, state, sent, record);
    owns.act(sent[0]);
    ++ticks;
    if (at_tick_s <= kPressing_s - kChecked_s) continue;
    follows.advance(at_tick_s);
    owns.observe(sent[0].force_N.norm());
    follows.observe(sent[1].force_N.norm());
  }
  return {owns.result(), follows.result()};
}

PressResult press_alone(const Model& wall, const PressingDevice& pressing, bool controller) {
  Presser alone(wall, pressing, Following{}.press_N, -kSeparation_mm / 2);
  Parameters parameters = parameters_of(controller);
  parameters.device[0] = alone.parameters(pressing.delay_s);
  const double tick_s = 1 / pressing.rate_hz;
  SessionState state;
  TickRecord record;
  Wrench sent;
  for (long n = 1; static_cast<double>(n) * tick_s <= kPressing_s; ++n) {
    const double now_s = static_cast<double>(n) * tick_s;
    alone.advance(now_s);
    alone.publish_sample();
    const DeviceState sensed = alone.state(now_s);
    tick(wall, parameters, {&sensed, 1}, tick_s, state, {&sent, 1}, record);
    alone.act(sent);
    if (now_s > kPressing_s - kChecked_s) alone.observe(sent.force_N.norm());
  }
  return alone.result();
}

Result<std::vector<Figure>> following_figures(const Progress& progress) {
  constexpr double kSlow_hz = 250;
  const auto wall = flat_wall(progress);
  if (!wall) return wall.error();
  std::vector<Figure> lengths, stiffnesses;
  for (const auto& [first, second] : {std::pair("premium-1.5", "touch"), std::pair("touch", "premium-1.5")}) {
    progress.report(std::string("following: ") + second + " behind " + first, 0);
    Following both{{*find_plant_device(first), {}}, {*find_plant_device(second), {}, 1, kSlow_hz}};
    PressingDevice alone = both.follower;
    const auto recommend = [&](PressingDevice& pressing, double delay_s) -> Result<void> {
      const auto stiffness =
          recommended_stiffness_N_per_mm(pressing.device, pressing.rate_hz, delay_s, progress);
      if (!stiffness) return stiffness.error();
      pressing.stiffness_N_per_mm = *stiffness;
      return {};
    };
    if (auto found = recommend(both.owner, both.owner.delay_s); !found) return found.error();
    if (auto found = recommend(both.follower, following_delay_s(both.owner, both.follower)); !found)
      return found.error();
    if (auto found = recommend(alone, alone.delay_s); !found) return found.error();

    const std::string path = std::string("stability/following/") + second + "/" +
                             loop_name(kSlow_hz, alone.delay_s) + "/behind-" + first + "/" +
                             loop_name(both.owner.rate_hz, both.owner.delay_s);
    stiffnesses.push_back({path + "/recommended", both.follower.stiffness_N_per_mm, "N/mm", 1, {}});
    stiffnesses.push_back({path + "/recommended-alone", alone.stiffness_N_per_mm, "N/mm", 1, {}});
    for (const char* grip : {"light-grip", "firm-grip"}) {
      if (progress.stopped()) return Progress::interrupted();
      both.owner.hand = both.follower.hand = alone.hand = *find_plant_hand(grip);
      const auto [owner, follower] = run_following(**wall, both);
      const auto swing = [&](const char* what, const PressResult& pressed, const PlantDevice& device) {
        lengths.push_back(
            {path + "/" + grip + "/" + what, pressed.swing_mm, "mm", 1, 2e3 * device.encoder_step_m});
      };
      swing("owner-swing", owner, both.owner.device);
      swing("owner-swing-alone", press_alone(**wall, both.owner), both.owner.device);
      swing("swing", follower, alone.device);
      swing("swing-alone", press_alone(**wall, alone), alone.device);
    }
  }
  lengths.insert(lengths.end(), stiffnesses.begin(), stiffnesses.end());
  return lengths;
}

}  // namespace palpate
