#include "palpate/device/device_parameters.h"

namespace palpate {

OutputLimits limits_of(const DeviceInfo& info) {
  OutputLimits limits;
  limits.peak_force_N = info.peak_force_N.value_or(kNotKnown);
  limits.continuous_force_N = info.continuous_force_N.value_or(kNotKnown);
  limits.peak_torque_Nmm = info.peak_torque_Nmm.value_or(kNotKnown);
  limits.peak_gripper_N = info.peak_gripper_N.value_or(kNotKnown);
  return limits;
}

double vouched_stiffness_N_per_mm(const DeviceInfo& info) {
  const double vouched = info.stiffness_N_per_mm.value_or(std::numeric_limits<double>::infinity());
  return vouched > 0 ? vouched : 0;
}

DeviceParameters device_parameters(const DeviceInfo& info, const WorkspaceSettings& settings) {
  DeviceParameters parameters;
  parameters.force_gain = settings.force_gain;
  parameters.scale = settings.scale;
  parameters.limits = limits_of(info);
  parameters.most_stiffness_N_per_mm = vouched_stiffness_N_per_mm(info);
  parameters.position_step_mm = info.position_step_mm.value_or(kNotKnown);
  return parameters;
}

}  // namespace palpate
