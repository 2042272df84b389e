#pragma once

#include <limits>
#include <string>

#include "palpate/device/device.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"

namespace palpate {

/// What one device may be sent. kNotKnown where nobody knows: then the user's limit alone holds for forces,
/// and torques and the gripper, for which the user sets no limit, stay off.
struct OutputLimits {
  double peak_force_N = kNotKnown;
  double continuous_force_N = kNotKnown;  ///< of the thermal budget; unknown: there is none
  double peak_torque_Nmm = kNotKnown;
  double peak_gripper_N = kNotKnown;
  /// Most change of force. A wall of 2 N/mm met at half a metre a second asks for 1000 N/s.
  double slew_N_per_s = 2000;
};
OutputLimits limits_of(const DeviceInfo& info);
/// The most stiffness that a device is made to feel, N/mm of the device: what its maker vouches for, and 0
/// for what is no stiffness (negative, not a number). Where that is not known, infinite for a simulated
/// device, and for a physical one careful_bounds(): none runs without a bound.
double bound_of_stiffness_N_per_mm(const DeviceInfo& info);
/// Whether that bound is ours and not the maker's, in words for whoever is to hold it; empty: it is not.
std::string careful_bound_told(const DeviceInfo& info);

/// Inputs of a tick that belong to one device.
struct DeviceParameters {
  double force_gain = 1;  ///< N at the device for one N in the patient (WorkspaceSettings::force_gain)
  double scale = 1;  ///< mm in the patient for one mm of the device; torques shrink with it, as the tool does
  OutputLimits limits;
  /// What a hand holds with the device, N/mm of the device, and no more than what its maker vouches for.
  /// Stiffer tissues are felt as this stiff: by the proxy each for itself, by the direct methods all softer
  /// by one factor.
  double most_stiffness_N_per_mm = std::numeric_limits<double>::infinity();
  double position_step_mm = kNotKnown;  ///< of its encoders: less is no motion to the passivity controller
  /// Damping that the device bears, N s/mm of the device: more of a tissue's viscosity, the published
  /// friction's and the coupling's is felt as so much. Not above 0 or not a number: nothing is known of it,
  /// and nothing clamped.
  double most_damping_N_s_per_mm = kNotKnown;
  /// From a command to its force, s; 0: none. The passivity observer counts with it. Whoever starts a loop
  /// may tell a longer one than the device's, and no shorter one.
  double delay_s = 0;
};
/// What is known of a device alone: as stiff as its maker vouches for, which a hand need not hold; of a
/// physical one of which that, the damping that it bears or its delay is not known, what is careful.
DeviceParameters device_parameters(const DeviceInfo& info, const WorkspaceSettings& settings);

}  // namespace palpate
