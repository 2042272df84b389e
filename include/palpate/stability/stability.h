#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/bounds.h"
#include "palpate/device/simulated_device.h"

/// Stiffness limits of rendered contact, from simulations with the simulated hand and device. See
/// docs/results/stability.md.
namespace palpate {

/// Conditions under which a virtual wall is held. SI units, as in the plant.
struct StabilityCase {
  PlantDevice device;
  PlantHand hand;
  double rate_hz = 1000;  ///< 100 ... 20000
  double delay_s = 0;     ///< Delay from a command to its force, 0 ... SimulatedDevice::kMaxDelay_s
};

/// Upper limit of the search.
inline constexpr double kStiffestWall_N_per_mm = 100;

/// Critical stiffness: the highest stiffness, in steps of 5 %, below which no limit cycle occurs. The wall is
/// unilateral, with force proportional to the depth that the encoder reads; it is touched at 0, 0.1 and 0.5
/// m/s and held at 1 N. A limit cycle is an oscillation of the true tip by more than two encoder steps, peak
/// to peak over a second, from the second second of the hold on, that does not decay. Deterministic.
/// kStiffestWall_N_per_mm if none occurs. Errors: kBadInput for parameters out of range, a device without
/// encoder step or a hand without stiffness, which cannot hold; kInterrupted.
Result<double> critical_stiffness_N_per_mm(const StabilityCase& stability_case,
                                           const Progress& progress = {});

/// Stiffness that is passive with any hand: min(2b/T, 2 f_c / encoder step), without delay (Abbott & Okamura
/// 2005).
/// @param rate_hz  > 0
double passivity_bound_N_per_mm(const PlantDevice& device, double rate_hz);

/// Grips over which the recommended stiffness is minimised: light and firm grip, each rigidly coupled to the
/// device and as a pen grip with skin compliance. A fingertip that only rests on the device relies on the
/// passivity controller; without it, hardly any stiffness is stable there.
const std::vector<PlantHand>& recommending_grips();

/// kStiffnessMargin times the minimum critical stiffness over recommending_grips(). Errors as above.
Result<double> recommended_stiffness_N_per_mm(const PlantDevice& device, double rate_hz, double delay_s,
                                              const Progress& progress = {});

/// kStiffnessMargin times neutral_damping_N_s_per_mm for the device's mass alone: valid for any grip, even a
/// fingertip.
double recommended_damping_N_s_per_mm(const PlantDevice& device, double rate_hz, double delay_s);

}  // namespace palpate
