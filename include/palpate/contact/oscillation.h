#pragma once

#include "palpate/geometry/geometry.h"

namespace palpate {

/// State of the oscillation detector.
struct OscillationState {
  Vector<World> axis;                      ///< Direction of the last force
  double displacement_mm = 0, time_s = 0;  ///< Displacement along the axis and time since the last reversal
  /// Extremum of displacement_mm since the last reversal, and its time.
  double farthest_mm = 0, farthest_s = 0;
  Vector<World> lateral_mm;          ///< Lateral displacement since the last reversal
  double previous_amplitude_mm = 0;  ///< Amplitude of the previous half cycle
  int half_cycles = 0;               ///< Number of consecutive half cycles of a self-sustained oscillation
  double free_space_s = 0;           ///< Time since the last contact
  double extra_delay_s = 0;          ///< Estimate of the force delay beyond the known one
};

/// Detects a self-sustained oscillation of the operator's hand against a contact. The energy that sustains it
/// is not measured by the passivity observer, which indicates that the actual force delay exceeds the known
/// one; the excess is estimated.
///
/// A self-sustained oscillation reverses along the force at least three times without decaying. It is faster
/// than 6.7 Hz, has an amplitude of at least OscillationSettings::min_amplitude_mm and a mean speed of 15
/// mm/s, and its lateral displacement is at most its amplitude. Tapping with a finger is slower, a tremor of
/// 8 to 12 Hz has a smaller amplitude, and sliding over ribs has a larger lateral displacement.
/// @param force_N          requested force; zero in free space
/// @param displacement_mm  displacement of the tip since the last tick, relative to the object; mm of the
///                         device
/// @param encoder_step_mm  encoder step
/// @param dt_s             length of the tick
/// @param state            detector state, updated; state.extra_delay_s is the estimate
void detect_oscillation(const Vector<World>& force_N, const Vector<World>& displacement_mm,
                        double encoder_step_mm, double dt_s, OscillationState& state);

}  // namespace palpate
