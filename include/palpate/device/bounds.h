#pragma once

#include "palpate/device/device.h"

/// Stiffness and damping that a device can render stably, from theory alone. They apply to devices that have
/// not been measured.
namespace palpate {

/// Safety factor: recommended fraction of the stiffness or damping at the stability limit.
inline constexpr double kStiffnessMargin = 0.6;

/// b / (T/2 + t_d): the stiffness at which a sampled spring generates as much energy as the damping b
/// dissipates (Colgate & Schenkel 1997). Without friction and encoder quantisation this is the critical
/// stiffness. N/mm.
/// @param delay_s  from a command to its force
inline double theoretical_stiffness_N_per_mm(double damping_N_s_per_m, double rate_hz, double delay_s) {
  return damping_N_s_per_m / (0.5 / rate_hz + delay_s) * 1e-3;
}

/// Damping coefficient c at which a bare mass oscillates without decay if the force -c v is commanded for the
/// mean velocity v over the window W (VelocityWindow), with the delay t_d and the zero-order hold of half a
/// tick:
///
///     m s^2 + c/W (1 - e^(-s W)) e^(-s (t_d + T/2)) = 0
///
/// For s = j w the phase condition holds at w = pi / (2 (t_d + T/2 + W/2)), which gives c = m w^2 W / (2
/// sin(w W/2)): there the force lags a quarter of a period and drives the motion instead of braking it. A
/// larger mass and any damping of hand or device allow more. N s/mm.
/// @param rate_hz  above 0
double neutral_damping_N_s_per_mm(double mass_kg, double rate_hz, double delay_s);

/// Values assumed for a device that does not state them.
struct ConservativeDevice {
  double rate_hz = 250;          ///< Slowest loop rate, kMinRate_hz
  double delay_s = 4e-3;         ///< Longer than any device's published delay known to us
  double mass_kg = 0.045;        ///< Mass of the lightest known device, the Touch
  double damping_N_s_per_m = 0;  ///< Damping of the device, without the hand's
  double hand_N_s_per_m = 2;     ///< Damping of the lightest known grip ("light-grip")
};

/// Delay from a command to its force as the device states it, s. If it states none or an implausible value
/// (outside 0 ... 1 s): ConservativeDevice::delay_s, or 0 for a simulated device.
double conservative_delay_s(const DeviceInfo& info);

/// Conservative limits for a device.
struct ConservativeBounds {
  double stiffness_N_per_mm = 0, damping_N_s_per_mm = 0;  ///< Limits at the device
};
/// kStiffnessMargin times the theoretical limits, using the device's stated properties and ConservativeDevice
/// for the others. For a device without any of these: 0.2 N/mm and 0.0042 N s/mm.
ConservativeBounds conservative_bounds(const DeviceInfo& info);

}  // namespace palpate
