#pragma once

#include <optional>

namespace palpate::dhd {

/// What public documents say of a device. What is not said is empty.
struct DeviceModel {
  const char* name;
  std::optional<double> peak_force_N, peak_gripper_N, peak_torque_Nmm, position_step_mm;
  std::optional<double> reach_mm;  ///< radius of the ball that the tip reaches
  bool turns = false;              ///< it has a wrist that tells how the tool is turned
  bool gripper = false;
  int buttons = 1;
  bool by_hand = false;  ///< is initialised by moving it through its workspace, and never moves by itself
};

/// By dhdGetSystemType. Of a type that is not known all is empty but the name.
DeviceModel model_of(int type);

}  // namespace palpate::dhd
