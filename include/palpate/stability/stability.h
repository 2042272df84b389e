#pragma once

#include "palpate/base/progress.h"
#include "palpate/device/simulated_device.h"

/// How stiff a wall may be felt, found with the simulated hand and device. See docs/verify.md, suite
/// `stability`.
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

/// Part of the critical stiffness that is recommended.
inline constexpr double kStiffnessMargin = 0.6;

/// kStiffnessMargin of the least critical stiffness over the light and the firm grip. Errors as above.
Result<double> recommended_stiffness_N_per_mm(const PlantDevice& device, double rate_hz, double delay_s,
                                              const Progress& progress = {});

/// The damping that makes a bare mass swing for ever when a force -c v is sent for the mean velocity of the
/// last window (VelocityWindow), after the delay and half a tick's hold:
///
///   m s^2 + c/W (1 - e^(-s W)) e^(-s (t_d + T/2)) = 0
///
/// On s = j w the phase is whole at w = pi / (2 (t_d + T/2 + W/2)), and there c = m w^2 W / (2 sin(w W/2)):
/// the force then comes a quarter of a swing late and pushes instead of braking. More mass and any damping of
/// hand or device allow more.
/// @param rate_hz  > 0
double neutral_damping_N_s_per_mm(double mass_kg, double rate_hz, double delay_s);

/// kStiffnessMargin of that for the device's mass alone: whoever holds it, even with a fingertip.
double recommended_damping_N_s_per_mm(const PlantDevice& device, double rate_hz, double delay_s);

}  // namespace palpate
