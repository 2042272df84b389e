#pragma once

namespace palpate {

/// State of an impact since contact began from free space. Lengths and speeds are along the force, positive
/// inward, in mm of the device.
struct ReboundState {
  bool touched = false;             ///< Whether contact has begun
  double impact_mm_s = 0;           ///< Impact speed
  double time_s = 0, depth_mm = 0;  ///< Time and displacement since the first tick of contact
  double impulse_N_s = 0;           ///< Impulse of the force that has acted since then
  /// Integral of impulse_N_s over time; a free mass is decelerated by this over its mass.
  double impulse_integral_N_s2 = 0;
  // sums of the least-squares line through the origin: deceleration distance over impulse_integral_N_s2
  double sum_lag_impulse_N_s2_mm = 0, sum_impulse_squared_N2_s4 = 0;
};

/// Inputs of limit_rebound_N() for one tick.
struct ReboundInput {
  double acting_force_N = 0;   ///< Force that acted since the last tick, along the requested force
  double displacement_mm = 0;  ///< Displacement of the tip since then, outward
  double speed_mm_s = 0;       ///< Mean speed of the last 10 ms, outward
  double encoder_step_mm = 0;  ///< Encoder step
  double pending_N_s = 0;      ///< Impulse along the force that was sent and has not acted yet
  double dt_s = 0;
};

/// Maximum force for which the tip rebounds with at most ReboundSettings::max_restitution times its impact
/// speed; N. Infinite where no faster rebound is predicted.
///
/// Energy accounting reacts too late here: a light tip reverses within two ticks on a stiff surface, the
/// encoder shows the reversal one step later, and forces already sent still act after a delay. While the tip
/// is decelerated, however, its apparent mass follows from the force that has acted and the distance by which
/// it lags behind unhindered motion; and the mass predicts the speed once all pending forces have acted. An
/// operator who presses has a large apparent mass and is not affected.
/// @param input  inputs of this tick
/// @param state  impact state, updated
double limit_rebound_N(const ReboundInput& input, ReboundState& state);

}  // namespace palpate
