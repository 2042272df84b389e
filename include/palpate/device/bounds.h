#pragma once

#include "palpate/device/device.h"

/// How stiff and how damped a device may be made to feel, by theory alone: what holds with one that nobody
/// has tried.
namespace palpate {

/// Part of what begins to swing that is recommended.
inline constexpr double kStiffnessMargin = 0.6;

/// b / (T/2 + t_d), where a sampled spring gives out as much energy as the damping takes (Colgate & Schenkel
/// 1997): without friction and encoder steps the critical stiffness.
inline double theoretical_stiffness_N_per_mm(double damping_N_s_per_m, double rate_hz, double delay_s) {
  return damping_N_s_per_m / (0.5 / rate_hz + delay_s) * 1e-3;
}

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

/// What is taken for a device where it says nothing else.
struct CarefulDevice {
  double rate_hz = 250;          ///< the slowest loop that there is
  double delay_s = 4e-3;         ///< longer than that of any device that we have read of
  double mass_kg = 0.045;        ///< of the lightest device that we know, the Touch
  double damping_N_s_per_m = 0;  ///< of the device, beside the hand's
  double hand_N_s_per_m = 2;     ///< of the lightest grip that we know ("light-grip")
};

/// From a command to its force, s: what the device states. One that states nothing, or what no arm has,
/// counts as CarefulDevice; a simulated one as without delay.
double careful_delay_s(const DeviceInfo& info);

struct CarefulBounds {
  double stiffness_N_per_mm = 0, damping_N_s_per_mm = 0;  ///< both of the device
};
/// kStiffnessMargin of what theory allows, for what is known of the device and CarefulDevice for the rest.
/// Of one of which nothing is known: 0.2 N/mm and 0.0042 N s/mm.
CarefulBounds careful_bounds(const DeviceInfo& info);

}  // namespace palpate
