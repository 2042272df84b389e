#include "verification/removal_plants.h"

#include <optional>

#include "palpate/stability/stability.h"
#include "verification/stability_energy.h"
#include "verification/stability_wall.h"

namespace palpate {
namespace {

constexpr double kCuttingRate_hz = 1000, kPlantsBurr_mm = 2;

struct CuttingPlant {
  const char *device, *grip;
};
constexpr CuttingPlant kCuttingPlants[] = {{"premium-1.5", "light-grip"},
                                           {"premium-1.5", "firm-grip"},
                                           {"premium-1.5", "whole-arm"},
                                           {"touch", "light-grip"},
                                           {"touch", "firm-grip"}};

}  // namespace

Result<Model> wall_for_burr(const Progress& progress) {
  const auto wall = flat_wall(progress);
  if (!wall) return wall.error();
  Model model = **wall;
  model.tools[0].radius_mm = kPlantsBurr_mm;
  model.tools[0].burr = BurrSettings{.spindle = Eigen::Vector3d(0, 1, 0)};
  return model;
}

Result<std::vector<Figure>> cutting_plants_figures(const CuttingTimes& times, const Progress& progress) {
  const auto wall = wall_for_burr(progress);
  if (!wall) return wall.error();
  std::vector<Figure> energies, swings, forces;
  for (const auto& [device, grip] : kCuttingPlants) {
    Exploration exploration{*find_plant_device(device), *find_plant_hand(grip)};
    const auto stiffness = recommended_stiffness_N_per_mm(exploration.device, kCuttingRate_hz, 0, progress);
    if (!stiffness) return stiffness.error();
    exploration.stiffness_N_per_mm = *stiffness;
    exploration.rate_hz = kCuttingRate_hz;
    exploration.flat = exploration.cuts = true;
    exploration.time_s = times.explored_s;
    if (progress.stopped()) return Progress::interrupted();
    const EnergyBalance explored = simulate_exploration(*wall, exploration);
    exploration.presses = true;
    exploration.time_s = times.pressed_s;
    const EnergyBalance drilling = simulate_exploration(*wall, exploration);
    exploration.motor_stops_s = times.pressed_s / 4;
    const EnergyBalance in_hole = simulate_exploration(*wall, exploration);
    exploration.motor_stops_s = exploration.time_s = times.settled_s;
    if (progress.stopped()) return Progress::interrupted();
    const EnergyBalance settled = simulate_exploration(*wall, exploration);
    exploration.cuts = false;
    exploration.time_s = times.pressed_s;
    const EnergyBalance still = simulate_exploration(*wall, exploration);

    const std::string path = std::string("removal/") + device + "/" + grip;
    const auto ticks = [](double seconds) { return static_cast<std::uint64_t>(seconds * kCuttingRate_hz); };
    const double step_mm = exploration.device.encoder_step_m * 1e3;
    // energy within one encoder step, which cannot be observed
    const double hidden_mJ = explored.largest_force_N * 2 * step_mm;
    energies.push_back({path + "/given-out", 0 - explored.min_mJ, "mJ", ticks(times.explored_s), hidden_mJ});
    energies.push_back({path + "/put-in", explored.last_mJ, "mJ", ticks(times.explored_s), {}});
    const auto swing = [&](const char* name, const EnergyBalance& of, double seconds,
                           std::optional<double> limit_mm) {
      swings.push_back({path + "/swing" + name, of.swing_mm, "mm", ticks(seconds / 2), limit_mm});
      forces.push_back({path + "/pressed" + name, of.pressed_N, "N", ticks(seconds / 2), {}});
    };
    swing("", drilling, times.pressed_s, 2 * step_mm);
    swing("-settled", settled, times.settled_s, 2 * step_mm);
    swing("-in-its-hole", in_hole, times.pressed_s, 2 * step_mm);
    swing("-motor-off", still, times.pressed_s, {});
  }
  energies.insert(energies.end(), swings.begin(), swings.end());
  energies.insert(energies.end(), forces.begin(), forces.end());
  return energies;
}

}  // namespace palpate
