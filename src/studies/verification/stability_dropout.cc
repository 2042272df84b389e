#include "verification/stability_dropout.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "palpate/device/workspace.h"
#include "palpate/servo/servo.h"
#include "palpate/stability/stability.h"
#include "verification/figure_names.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

constexpr double kDropTick_s = 1e-3;
// durations of pressing before the interruption and of observation after it
constexpr double kPressed_s = 2.5, kWatched_s = 1;
constexpr double kBack = 0.8;
// age of a pose from which on no force may be sent, and duration for which the returning force is observed
constexpr double kSilent_s = 10e-3, kReturning_s = 0.1;

}  // namespace

DropoutResult drop_out(const Model& wall, const Dropout& dropout) {
  SimulatedDevice plant(dropout.device, dropout.hand, dropout.delay_s);
  WorkspaceSettings workspace;
  workspace.force_gain = dropout.stiffness_N_per_mm;
  WorkspaceMapping mapping(plant.info(), workspace);
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  parameters.device[0] = device_parameters(plant.info(), workspace);

  // from 1 mm above the wall to the equilibrium of the wall's and the hand's springs at this force
  const double hand_N_per_mm = dropout.hand.stiffness_N_per_m * 1e-3;
  const double depth_mm = dropout.press_N / dropout.stiffness_N_per_mm +
                          (dropout.press_N + dropout.device.coulomb_N) / hand_N_per_mm;
  const auto on_device = [&](double x_mm) {
    return mapping.to_device(wall.X_WorldPatient * Point<Patient>(x_mm, 0, 0));
  };
  const Vector<Device> out = on_device(1) - on_device(0);
  const auto height_mm = [&] { return out.dot(plant.true_tip() - on_device(0)); };
  const Vector<World> up = (wall.X_WorldPatient * Vector<Patient>(1, 0, 0)).normalized();
  plant.reset(on_device(1));

  const long pressed = std::lround(kPressed_s / kDropTick_s), watched = std::lround(kWatched_s / kDropTick_s);
  const long dropped = std::lround(dropout.time_s / kDropTick_s);
  SessionState state;
  TickRecord record;
  Wrench sent;
  DeviceSample sample = plant.read();
  DropoutResult result;
  result.silent = true;
  double before_mm = 0;
  long last_away = 0;
  for (long n = 0; n < pressed + dropped + watched; ++n) {
    const double age_s = n < pressed ? 0 : kDropTick_s * static_cast<double>(n - pressed + 1);
    const bool lost = n >= pressed && n < pressed + dropped;
    if (!lost) sample = plant.read();
    if (n == pressed) {
      before_mm = height_mm();
      result.before_N = sent.force_N.norm();
    }
    const double last_N = sent.force_N.norm();
    DeviceState sensed = mapping.to_world(sample, 0);
    sensed.age_s = lost ? age_s : 0;
    tick(wall, parameters, {&sensed, 1}, kDropTick_s, state, {&sent, 1}, record);
    if (lost && age_s >= kSilent_s) result.silent = result.silent && sent.force_N == Vector<World>();
    if (dropout.returning != ReturningForce::kByTick && n >= pressed + dropped) {
      const double requested_N = record.device[0].unclamped_force_N;
      sent.force_N = up * (dropout.returning == ReturningForce::kAtOnce ? requested_N : last_N + kMaxKick_N);
      // the tip has reversed: the bound excludes sinking by the momentum of the fall
      if (out.dot(plant.true_velocity_mm_s()) > 0) break;
    }

    const double down = std::min(1.0, static_cast<double>(n + 1) / (0.5 * static_cast<double>(pressed)));
    plant.intend(on_device(1 - down * (1 + depth_mm)));
    plant.advance(mapping.to_device(sent), kDropTick_s);
    if (n < pressed) continue;
    result.sinking_mm = std::max(result.sinking_mm, before_mm - height_mm());
    if (sent.force_N.norm() < kBack * result.before_N) last_away = n + 1;
    const bool returning = !lost && n < pressed + dropped + std::lround(kReturning_s / kDropTick_s);
    if (returning) result.kick_N = std::max(result.kick_N, sent.force_N.norm() - last_N);
  }
  result.back_s = kDropTick_s * static_cast<double>(std::max(0L, last_away - pressed - dropped));
  return result;
}

Result<std::vector<Figure>> dropout_figures(const Progress& progress) {
  constexpr double kDelay_s = 1e-3, kMaxSinking_mm = 0.6, kMaxBack_ms = 100;
  const auto wall = flat_wall(progress);
  if (!wall) return wall.error();
  // grouped by unit, as required by the table
  std::vector<Figure> lengths, times, forces;
  for (const char* name : {"premium-1.5", "touch"}) {
    const PlantDevice device = *find_plant_device(name);
    progress.report(std::string("poses that fail to come: ") + name, 0);
    const auto stiffness = recommended_stiffness_N_per_mm(device, 1 / kDropTick_s, kDelay_s, progress);
    if (!stiffness) return stiffness.error();
    for (const PlantHand& hand : known_plant_hands()) {
      if (progress.stopped()) return Progress::interrupted();
      Dropout dropout{device, hand, *stiffness, kDelay_s};
      const DropoutResult lost = drop_out(**wall, dropout);
      dropout.returning = ReturningForce::kAtOnce;
      const DropoutResult at_once = drop_out(**wall, dropout);
      dropout.returning = ReturningForce::kWithoutKick;
      const DropoutResult without_kick = drop_out(**wall, dropout);
      // a hand that cannot meet it even in the ideal case is exempt
      const bool can = without_kick.sinking_mm <= kMaxSinking_mm;
      const std::string path =
          "stability/dropout/" + device.name + "/" + hand.name + "/" + loop_name(1 / kDropTick_s, kDelay_s);
      lengths.push_back(
          {path + "/sink", lost.sinking_mm, "mm", 1, can ? std::optional(kMaxSinking_mm) : std::nullopt});
      lengths.push_back({path + "/floor", without_kick.sinking_mm, "mm", 1, {}});
      lengths.push_back({path + "/floor-at-once", at_once.sinking_mm, "mm", 1, {}});
      times.push_back({path + "/back", lost.back_s * 1e3, "ms", 1, kMaxBack_ms});
      forces.push_back({path + "/kick", lost.kick_N, "N", 1, kMaxKick_N});
    }
  }
  lengths.insert(lengths.end(), times.begin(), times.end());
  lengths.insert(lengths.end(), forces.begin(), forces.end());
  return lengths;
}

}  // namespace palpate
