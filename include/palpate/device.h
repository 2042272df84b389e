#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/geometry.h"
#include "palpate/progress.h"
#include "palpate/result.h"

/// The device port: states in, wrenches out. And the simulated device on which everything is tested.
namespace palpate {

inline constexpr int kMaxDevices = 4;

/// What a device (or a simulated hand) reports to one tick, already mapped to the workspace.
struct DeviceState {
  Point<World> tip;  ///< mm
  Eigen::Quaterniond R_WorldTool = Eigen::Quaterniond::Identity();
  std::uint32_t buttons = 0;  ///< bit n: button n is held
};

/// What a tick answers: a force and a torque about the tip.
struct Wrench {
  Vector<World> force_N;
  Vector<World> torque_Nmm;
};

/// What is known about a device; what is not known is empty, not zero.
struct DeviceInfo {
  std::string name;
  std::optional<double> peak_force_N;
  std::optional<double> continuous_force_N;
  std::optional<double> position_step_mm;  ///< encoder resolution
  int degrees_of_freedom_in = 3;
  int degrees_of_freedom_out = 3;
  int buttons = 0;
};

/// Mechanical constants of a simulated device (methods: Abbott & Okamura 2005; Diolaiti 2006). SI.
struct PlantDevice {
  std::string name;
  double mass_kg, damping_N_s_per_m, coulomb_N, encoder_step_m, peak_force_N, continuous_force_N;
};
/// The hand between the intended and the actual position. SI.
struct PlantHand {
  std::string name;
  double mass_kg, damping_N_s_per_m, stiffness_N_per_m;
};

/// "premium-1.5", "touch"
const std::vector<PlantDevice>& known_plant_devices();
/// "light-grip", "firm-grip", "whole-arm"
const std::vector<PlantHand>& known_plant_hands();
Result<PlantDevice> find_plant_device(const std::string& name);
Result<PlantHand> find_plant_hand(const std::string& name);

/// A hand holding a device, on a virtual clock: intended position - hand - device mass - encoder
/// (floor quantiser) - servo - delay line - saturation - zero-order hold. Semi-implicit Euler in
/// steps of 10 us, Coulomb friction with stick. Deterministic.
class SimulatedDevice {
 public:
  SimulatedDevice(const PlantDevice& device, const PlantHand& hand, double delay_s = 0);

  DeviceInfo info() const;
  /// Places everything at rest at `tip`.
  void reset(const Point<World>& tip);
  /// Where the hand wants the tip to be at the end of the next advance; it moves there evenly.
  void intend(const Point<World>& target) { target_mm_ = target; }
  /// What the encoders say now.
  DeviceState read() const;
  /// The true tip, unquantised, for tests and figures.
  Point<World> true_tip() const;
  Vector<World> true_velocity_mm_s() const;
  /// Holds the commanded force (saturated, delayed) and integrates the mechanics for dt.
  void advance(const Wrench& command, double dt_s);

 private:
  PlantDevice device_;
  PlantHand hand_;
  double delay_s_;
  Point<World> target_mm_, previous_target_mm_;
  Eigen::Vector3d position_m_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_s_ = Eigen::Vector3d::Zero();
  double time_s_ = 0;
  // commanded forces with the time from which each acts, oldest first; the first one is acting
  struct Command {
    double from_s;
    Eigen::Vector3d force_N;
  };
  std::vector<Command> line_;
};

}  // namespace palpate
