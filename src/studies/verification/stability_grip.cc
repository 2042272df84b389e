#include "verification/stability_grip.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <optional>
#include <vector>

#include "palpate/device/device_parameters.h"
#include "palpate/servo/servo.h"
#include "palpate/stability/stability.h"
#include "verification/figure_names.h"
#include "verification/stability_energy.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

constexpr double kGripStep_s = 1e-5;
constexpr double kAbove_mm = 3, kFadeIn_s = 0.6;
// distance at which the wall exerts no force, including delayed ones
constexpr double kClear_mm = 1;
constexpr double kSettledSwing_mm = 0.2, kSettledFor_s = 0.1;

DeviceInfo rate_alone(double rate_hz) {
  DeviceInfo info;
  info.rate_hz = rate_hz;
  return info;
}

// explicit Euler step of a mass with Coulomb friction, which can stop it but not reverse it
void push(double force_N, double friction_N, double mass_kg, double& velocity_m_s) {
  velocity_m_s += force_N * kGripStep_s / mass_kg;
  const double max_m_s = friction_N * kGripStep_s / mass_kg;
  velocity_m_s = std::abs(velocity_m_s) > max_m_s ? velocity_m_s - std::copysign(max_m_s, velocity_m_s) : 0;
}

/// Device and hand along x, m.
class GripPlant {
 public:
  GripPlant(const PlantDevice& device, const Grip& grip, double at_m)
      : device_(device), grip_(grip), tip_m_(at_m), hand_m_(at_m) {}

  // releases the device
  void throw_it(double speed_m_s) {
    free_ = true;
    tip_m_s_ = hand_m_s_ = speed_m_s;
  }
  double tip_mm() const { return tip_m_ * 1e3; }
  double speed_m_s() const { return tip_m_s_; }
  double read_mm() const {
    return std::floor(tip_m_ / device_.encoder_step_m) * device_.encoder_step_m * 1e3;
  }
  void step(double force_N, double target_m, double target_m_s) {
    const bool one = grip_.skin_N_per_m == 0;
    double& hand_m = one ? tip_m_ : hand_m_;
    double& hand_m_s = one ? tip_m_s_ : hand_m_s_;
    const double hand_N = free_ ? 0
                                : grip_.stiffness_N_per_m * (target_m - hand_m) +
                                      grip_.damping_N_s_per_m * (target_m_s - hand_m_s);
    const double device_N = force_N - device_.damping_N_s_per_m * tip_m_s_;
    if (one) {
      push(hand_N + device_N, device_.coulomb_N, grip_.mass_kg + device_.mass_kg, tip_m_s_);
    } else {
      const double skin_N =
          grip_.skin_N_per_m * (hand_m_ - tip_m_) + grip_.skin_N_s_per_m * (hand_m_s_ - tip_m_s_);
      push(device_N + skin_N, device_.coulomb_N, device_.mass_kg, tip_m_s_);
      push(hand_N - skin_N, 0, grip_.mass_kg, hand_m_s_);
      hand_m_ += hand_m_s_ * kGripStep_s;
    }
    tip_m_ += tip_m_s_ * kGripStep_s;
  }

 private:
  PlantDevice device_;
  Grip grip_;
  bool free_ = false;
  double tip_m_, tip_m_s_ = 0, hand_m_, hand_m_s_ = 0;
};

double swing_of(std::span<const double> distance_mm) {
  const auto [low, high] = std::minmax_element(distance_mm.begin(), distance_mm.end());
  return *high - *low;
}

}  // namespace

GripResult hold_wall(const Model& wall, const GripCase& grip_case) {
  Model model = wall;
  for (Tissue& tissue : model.tissues)
    tissue.viscosity_N_s_per_mm = grip_case.viscosity_N_s_per_mm / grip_case.stiffness_N_per_mm;
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  parameters.passivity = grip_case.controller;
  parameters.device[0].limits.peak_force_N = grip_case.device.peak_force_N;
  parameters.device[0].max_damping_N_s_per_mm = grip_case.max_damping_N_s_per_mm;
  parameters.device[0].delay_s = grip_case.reported_s.value_or(grip_case.delay_s);
  parameters.device[0].position_step_mm = grip_case.device.encoder_step_m * 1e3;
  if (grip_case.states_nothing) parameters.device[0] = device_parameters(rate_alone(grip_case.rate_hz), {});
  parameters.device[0].force_gain = grip_case.stiffness_N_per_mm;

  // approaches at the impact speed, to the equilibrium of the hand's and the wall's springs at this force
  const double depth_mm = grip_case.press_N / grip_case.stiffness_N_per_mm +
                          grip_case.press_N / grip_case.grip.stiffness_N_per_m * 1e3;
  GripPlant plant(grip_case.device, grip_case.grip, kAbove_mm * 1e-3);
  const double dt_s = 1 / grip_case.rate_hz;
  const int steps = static_cast<int>(std::lround(dt_s / kGripStep_s));
  std::deque<double> line(static_cast<std::size_t>(std::lround(grip_case.delay_s / kGripStep_s)), 0.0);
  SessionState state;
  TickRecord record;
  Wrench sent;
  const double touch_s = kFadeIn_s + kAbove_mm * 1e-3 / grip_case.impact_m_s;
  const long ticks = std::lround((touch_s + grip_case.time_s) * grip_case.rate_hz);
  std::vector<double> distance_mm, force_N;
  double target_mm = kAbove_mm;
  double in_m_s = 0;
  GripResult result;
  bool inside = false, left = false, thrown = false;
  for (long n = 0; n < ticks; ++n) {
    DeviceState sensed;
    sensed.tip = model.X_WorldPatient * Point<Patient>(plant.read_mm(), 0, 0);
    tick(model, parameters, {&sensed, 1}, dt_s, state, {&sent, 1}, record);
    const double command_N = (model.X_WorldPatient.inverse() * sent.force_N).x();
    const double time_s = static_cast<double>(n + 1) * dt_s;
    const double down_mm =
        std::clamp(grip_case.impact_m_s * 1e3 * (time_s - kFadeIn_s), 0.0, kAbove_mm + depth_mm);
    const double target_m_s = (kAbove_mm - down_mm - target_mm) * 1e-3 / dt_s;
    if (grip_case.free && !thrown && time_s > kFadeIn_s) {
      plant.throw_it(-grip_case.impact_m_s);
      thrown = true;
    }
    for (int i = 0; i < steps; ++i) {
      line.push_back(command_N);
      const double target_m = target_mm * 1e-3 + target_m_s * (i + 1) * kGripStep_s;
      plant.step(line.front(), target_m, target_m_s);
      line.pop_front();
      if (!inside && plant.tip_mm() < kClear_mm) {
        inside = true;
        in_m_s = plant.speed_m_s();
      }
      if (inside && !left && plant.tip_mm() > kClear_mm) {
        left = true;
        result.rebound = -plant.speed_m_s() / in_m_s;
      }
    }
    target_mm = kAbove_mm - down_mm;
    if (time_s < touch_s) continue;
    distance_mm.push_back(plant.tip_mm());
    force_N.push_back(command_N);
  }

  const auto second = static_cast<std::size_t>(std::lround(grip_case.rate_hz));
  const auto last = std::span(distance_mm).last(std::min(second, distance_mm.size()));
  result.swing_mm = swing_of(last);
  const auto [low, high] = std::minmax_element(last.begin(), last.end());
  const double middle_mm = 0.5 * (*low + *high);
  for (std::size_t n = 1; n < last.size(); ++n)
    result.crossings_hz += last[n - 1] < middle_mm && last[n] >= middle_mm;
  for (std::size_t n = force_N.size() - last.size(); n < force_N.size(); ++n)
    result.force_N += force_N[n] / static_cast<double>(last.size());
  const auto piece = static_cast<std::size_t>(std::lround(kSettledFor_s * grip_case.rate_hz));
  for (std::size_t n = 0; n + piece <= distance_mm.size(); ++n)
    if (swing_of(std::span(distance_mm).subspan(n, piece)) > kSettledSwing_mm)
      result.settled_s = static_cast<double>(n + piece) * dt_s;
  return result;
}

namespace {

GripCase free_tap(const PlantDevice& device, double stiffness_N_per_mm) {
  GripCase tap{.device = device, .grip = {.mass_kg = 0.001}, .stiffness_N_per_mm = stiffness_N_per_mm};
  tap.device.coulomb_N = tap.device.damping_N_s_per_m = 0;
  tap.press_N = 0;
  tap.free = true;
  tap.time_s = 0.2;
  return tap;
}

// Oscillation and energy for each hand with skin, at the recommended stiffness, with the tick informed of the
// delay. Each figure is the worst over all delays at one rate.
Result<void> add_hands_with_skin(const Model& wall, const Model& ball, const PlantDevice& device,
                                 const Progress& progress, std::vector<Figure>& lengths,
                                 std::vector<Figure>& energies) {
  constexpr double kExplored_s = 15;
  for (const double rate_hz : {1000.0, 500.0, 250.0}) {
    const std::size_t grips = plant_hands_with_skin().size();
    std::vector<double> swing_mm(grips), out_mJ(grips);
    for (const double delay_s : {0.0, 1e-3, 2e-3, 4e-3}) {
      progress.report("hands with skin: " + device.name, 0);
      const auto stiffness = recommended_stiffness_N_per_mm(device, rate_hz, delay_s, progress);
      if (!stiffness) return stiffness.error();
      for (std::size_t n = 0; n < grips; ++n) {
        if (progress.stopped()) return Progress::interrupted();
        const PlantHand& hand = plant_hands_with_skin()[n];
        for (const double impact_m_s : {0.05, 0.1, 0.5}) {
          const GripCase grip_case{.device = device,
                                   .grip = grip_of(hand),
                                   .stiffness_N_per_mm = *stiffness,
                                   .rate_hz = rate_hz,
                                   .delay_s = delay_s,
                                   .impact_m_s = impact_m_s};
          swing_mm[n] = std::max(swing_mm[n], hold_wall(wall, grip_case).swing_mm);
        }
        Exploration exploration{device, hand};
        exploration.stiffness_N_per_mm = *stiffness;
        exploration.rate_hz = rate_hz;
        exploration.delay_s = delay_s;
        exploration.time_s = kExplored_s;
        out_mJ[n] = std::max(out_mJ[n], -simulate_exploration(ball, exploration).min_mJ);
      }
    }
    for (std::size_t n = 0; n < grips; ++n) {
      const std::string path = "stability/grip/" + device.name + "/" + short_number(rate_hz / 1000) +
                               "kHz/with-skin/" + plant_hands_with_skin()[n].name;
      lengths.push_back({path + "/swing", swing_mm[n], "mm", 1, 2e3 * device.encoder_step_m});
      energies.push_back({path + "/out/largest", out_mJ[n], "mJ", 1, {}});
    }
  }
  return {};
}

}  // namespace

Grip grip_of(const PlantHand& hand) {
  return {hand.mass_kg, hand.damping_N_s_per_m, hand.stiffness_N_per_m, hand.skin_N_per_m,
          hand.skin_N_s_per_m};
}

Result<std::vector<Figure>> grip_figures(const Progress& progress) {
  constexpr double kSkin_N_per_m = 2000, kMaxRebound = 1;
  const auto wall = flat_wall(progress);
  if (!wall) return wall.error();
  const auto ball = exploration_ball(progress);
  if (!ball) return ball.error();
  // grouped by unit, as required by the table
  std::vector<Figure> lengths, times, ratios, energies;
  for (const char* name : {"premium-1.5", "touch"}) {
    const PlantDevice device = *find_plant_device(name);
    progress.report(std::string("loose grips: ") + name, 0);
    const auto stiffness = recommended_stiffness_N_per_mm(device, 1000, 1e-3, progress);
    if (!stiffness) return stiffness.error();
    for (const bool reported : {true, false}) {
      const std::string path =
          "stability/grip/" + device.name + "/" + loop_name(1000, 1e-3) + (reported ? "/told" : "/not-told");
      for (const double damping_N_s_per_m : {0.3, 0.5})
        for (const double skin_N_per_m : {0.0, kSkin_N_per_m}) {
          if (progress.stopped()) return Progress::interrupted();
          GripCase grip_case{.device = device,
                             .grip = {.damping_N_s_per_m = damping_N_s_per_m, .skin_N_per_m = skin_N_per_m},
                             .stiffness_N_per_mm = *stiffness};
          if (!reported) grip_case.reported_s = 0;
          const GripResult result = hold_wall(**wall, grip_case);
          const std::string prefix = path + "/b-" + short_number(damping_N_s_per_m) +
                                     (skin_N_per_m > 0 ? "/two-masses" : "/one-mass");
          lengths.push_back({prefix + "/swing", result.swing_mm, "mm", 1, 2e3 * device.encoder_step_m});
          times.push_back({prefix + "/settled", result.settled_s, "s", 1, {}});
        }
      GripCase tap = free_tap(device, *stiffness);
      if (!reported) tap.reported_s = 0;
      ratios.push_back({path + "/free-tap/rebound", hold_wall(**wall, tap).rebound, "1", 1,
                        reported ? std::optional(kMaxRebound) : std::nullopt});
    }
    GripCase tap = free_tap(device, stiffness_bound_N_per_mm(rate_alone(1000)));
    tap.states_nothing = true;
    for (const double delay_s : {1e-3, 3e-3}) {
      tap.delay_s = delay_s;
      ratios.push_back({"stability/grip/" + device.name + "/" + loop_name(tap.rate_hz, delay_s) +
                            "/unknown/free-tap/rebound",
                        hold_wall(**wall, tap).rebound, "1", 1, kMaxRebound});
    }
    const auto added = add_hands_with_skin(**wall, **ball, device, progress, lengths, energies);
    if (!added) return added.error();
  }
  lengths.insert(lengths.end(), times.begin(), times.end());
  lengths.insert(lengths.end(), ratios.begin(), ratios.end());
  lengths.insert(lengths.end(), energies.begin(), energies.end());
  return lengths;
}

}  // namespace palpate
