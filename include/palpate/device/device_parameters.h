#pragma once

#include <limits>
#include <string>

#include "palpate/device/device.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"

namespace palpate {

/// Output limits of one device; kNoValue where unknown. Then forces are limited by the user's limit alone,
/// and torque and gripper force, for which the user sets no limit, stay off.
struct OutputLimits {
  double peak_force_N = kNoValue;
  /// Rating that the thermal budget is based on; unknown: no thermal limit
  double continuous_force_N = kNoValue;
  double peak_torque_Nmm = kNoValue;
  double peak_gripper_N = kNoValue;
  /// Limit of the rate of change of the force, N/s. A surface of 2 N/mm met at 0.5 m/s requires 1000 N/s.
  double slew_N_per_s = 2000;
};
/// Limits that the device states.
OutputLimits limits_of(const DeviceInfo& info);
/// Largest stiffness to render with a device, device N/mm: the value that its vendor vouches for, or 0 if
/// that is invalid (negative, NaN). If the vendor states none or an infinite one: infinite for a simulated
/// device, conservative_bounds() for a physical one, which is never run without a bound.
double stiffness_bound_N_per_mm(const DeviceInfo& info);
/// Message for the user if the bound is conservative_bounds() instead of the vendor's value; else empty.
std::string conservative_bound_message(const DeviceInfo& info);

/// Tick inputs that belong to one device.
struct DeviceParameters {
  double force_gain = 1;  ///< Device N per N in the patient (WorkspaceSettings::force_gain)
  double scale = 1;  ///< Patient mm per device mm; torques are divided by it, because lever arms scale too
  OutputLimits limits;
  /// Largest stiffness that an operator can hold stable with the device, device N/mm, at most the vendor's
  /// value. Stiffer tissues are rendered at this stiffness: by the proxy each tissue is clamped separately,
  /// by the direct methods all are scaled by one factor.
  double max_stiffness_N_per_mm = std::numeric_limits<double>::infinity();
  /// Encoder step; the passivity controller ignores smaller displacements
  double position_step_mm = kNoValue;
  /// Largest damping that the device renders stably, device N s/mm. Viscosity of tissue, the published
  /// friction and the coupling's damping are clamped to it. Not above 0 or NaN: unknown, no clamping.
  double max_damping_N_s_per_mm = kNoValue;
  /// Delay from a command to its force, s; 0: none. Used by the passivity observer. The caller of
  /// ServoLoop::start() may state a longer delay than the device does, but not a shorter one.
  double delay_s = 0;
};
/// Parameters from the device's own properties: the stiffness that its vendor vouches for, which an operator
/// need not be able to hold, and careful bounds for unknown stiffness, damping or delay of a physical device.
DeviceParameters device_parameters(const DeviceInfo& info, const WorkspaceSettings& settings);

}  // namespace palpate
