#pragma once

#include <optional>

namespace palpate::dhd {

/// Published specifications of a device; empty: unknown.
struct DeviceModel {
  const char* name;
  std::optional<double> peak_force_N, peak_gripper_N, peak_torque_Nmm, position_step_mm;
  std::optional<double> reach_mm;  ///< Radius of the tip's reachable ball
  bool turns = false;              ///< Whether it has a wrist that measures orientation
  bool gripper = false;
  int buttons = 1;
  /// Whether it is initialised manually, by moving it through its workspace, and never moves by itself
  bool by_hand = false;
};

/// Specifications by dhdGetSystemType. For an unknown type everything but the name is empty.
DeviceModel model_of(int type);

}  // namespace palpate::dhd
