#include "palpate/device/device_parameters.h"

#include <cmath>
#include <cstdio>

#include "palpate/device/bounds.h"

namespace palpate {

OutputLimits limits_of(const DeviceInfo& info) {
  OutputLimits limits;
  limits.peak_force_N = info.peak_force_N.value_or(kNoValue);
  limits.continuous_force_N = info.continuous_force_N.value_or(kNoValue);
  limits.peak_torque_Nmm = info.peak_torque_Nmm.value_or(kNoValue);
  limits.peak_gripper_N = info.peak_gripper_N.value_or(kNoValue);
  return limits;
}

namespace {

// physical devices whose vendor states no stiffness or an infinite one
bool needs_conservative_bound(const DeviceInfo& info) {
  return !info.simulated && (!info.stiffness_N_per_mm || std::isinf(*info.stiffness_N_per_mm));
}

}  // namespace

double stiffness_bound_N_per_mm(const DeviceInfo& info) {
  if (needs_conservative_bound(info)) return conservative_bounds(info).stiffness_N_per_mm;
  const double stated_N_per_mm = info.stiffness_N_per_mm.value_or(std::numeric_limits<double>::infinity());
  return stated_N_per_mm > 0 ? stated_N_per_mm : 0;
}

std::string conservative_bound_message(const DeviceInfo& info) {
  if (!needs_conservative_bound(info)) return "";
  char text[160];
  std::snprintf(text, sizeof text,
                "the stable stiffness of %s is unknown: stiffness is limited to a conservative %.2g N/mm",
                info.name.c_str(), conservative_bounds(info).stiffness_N_per_mm);
  return text;
}

DeviceParameters device_parameters(const DeviceInfo& info, const WorkspaceSettings& settings) {
  DeviceParameters parameters;
  // positions in the patient are not scaled
  parameters.force_gain = info.in_patient ? 1 : settings.force_gain;
  parameters.scale = info.in_patient ? 1 : settings.scale;
  parameters.limits = limits_of(info);
  parameters.max_stiffness_N_per_mm = stiffness_bound_N_per_mm(info);
  if (!info.simulated) parameters.max_damping_N_s_per_mm = conservative_bounds(info).damping_N_s_per_mm;
  parameters.delay_s = conservative_delay_s(info);
  parameters.position_step_mm = info.position_step_mm.value_or(kNoValue);
  return parameters;
}

}  // namespace palpate
