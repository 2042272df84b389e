#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/bounds.h"
#include "palpate/device/simulated_device.h"

/// How stiff a wall may be felt, found with the simulated hand and device. See docs/results/stability.md.
namespace palpate {

/// What a wall is held with. SI, as the plant.
struct StabilityCase {
  PlantDevice device;
  PlantHand hand;
  double rate_hz = 1000;  ///< 100 ... 20000
  double delay_s = 0;     ///< from a command to its force, 0 ... SimulatedDevice::kMostDelay_s
};

/// Stiffer walls are not tried.
inline constexpr double kStiffestWall_N_per_mm = 100;

/// The highest stiffness below which no limit cycle is met, in steps of 5 %: a single wall that pushes with
/// stiffness times depth as the encoder reads it, touched at 0, 0.1 and 0.5 m/s and held at 1 N. A limit
/// cycle is a swing of the true tip of more than two encoder steps, peak to peak over a second, from the
/// second second of the hold on, that does not die down. Deterministic. kStiffestWall_N_per_mm where none is
/// met. Errors: kBadInput for a case out of range, a device without encoder step or a hand without stiffness,
/// which holds nothing; kInterrupted.
Result<double> critical_stiffness_N_per_mm(const StabilityCase& held, const Progress& progress = {});

/// What is passive with whatever hand: min(2b/T, 2 f_c / encoder step), without delay (Abbott & Okamura
/// 2005).
/// @param rate_hz  > 0
double passivity_bound_N_per_mm(const PlantDevice& device, double rate_hz);

/// The grips that the recommended stiffness counts: the light and the firm grip, each of one mass with the
/// device and as it holds a pen, with skin between. A fingertip that only rests on the device counts on the
/// passivity controller: hardly any wall is stiff to it without.
const std::vector<PlantHand>& recommending_grips();

/// kStiffnessMargin of the least critical stiffness over recommending_grips(). Errors as above.
Result<double> recommended_stiffness_N_per_mm(const PlantDevice& device, double rate_hz, double delay_s,
                                              const Progress& progress = {});

/// kStiffnessMargin of neutral_damping_N_s_per_mm for the device's mass alone: whoever holds it, even with a
/// fingertip.
double recommended_damping_N_s_per_mm(const PlantDevice& device, double rate_hz, double delay_s);

}  // namespace palpate
