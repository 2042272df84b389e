#include "palpate/contact/oscillation.h"
#include "palpate/contact/contact_settings.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// evaluates a completed half cycle, from the last reversal to the extremum
void end_half_cycle(double encoder_step_mm, OscillationState& state) {
  const double length_mm = std::abs(state.farthest_mm), time_s = state.farthest_s;
  const bool is_self_sustained =
      length_mm >= std::max(kOscillationSettings.min_amplitude_mm,
                            kOscillationSettings.min_amplitude_steps * encoder_step_mm) &&
      time_s <= kOscillationSettings.max_half_cycle_s &&
      length_mm >= kOscillationSettings.min_speed_mm_s * time_s && state.lateral_mm.norm() <= length_mm;
  const bool has_not_decayed =
      length_mm >= kOscillationSettings.min_amplitude_ratio * state.previous_amplitude_mm;
  state.half_cycles = !is_self_sustained ? 0 : has_not_decayed ? state.half_cycles + 1 : 1;
  if (state.half_cycles >= kOscillationSettings.min_half_cycles)
    state.extra_delay_s = std::min(kOscillationSettings.max_extra_delay_s,
                                   state.extra_delay_s + kOscillationSettings.delay_increment_s);
  state.previous_amplitude_mm = length_mm;
}

}  // namespace

void detect_oscillation(const Vector<World>& force_N, const Vector<World>& displacement_mm,
                        double encoder_step_mm, double dt_s, OscillationState& state) {
  state.extra_delay_s = std::max(0.0, state.extra_delay_s - kOscillationSettings.extra_delay_decay * dt_s);
  const double force = force_N.norm();
  state.free_space_s = force > 0 ? 0 : state.free_space_s + dt_s;
  if (force > 0) state.axis = force_N / force;
  if (state.free_space_s > kOscillationSettings.reset_s) {
    const double extra_delay_s = state.extra_delay_s;
    state = {};
    state.extra_delay_s = extra_delay_s;
    state.free_space_s = kOscillationSettings.reset_s;
    return;
  }

  const double along_mm = displacement_mm.dot(state.axis);
  state.displacement_mm += along_mm;
  state.time_s += dt_s;
  state.lateral_mm += displacement_mm - state.axis * along_mm;
  if (std::abs(state.displacement_mm) > std::abs(state.farthest_mm) &&
      state.displacement_mm * state.farthest_mm >= 0) {
    state.farthest_mm = state.displacement_mm;
    state.farthest_s = state.time_s;
    return;
  }
  if (std::abs(state.farthest_mm - state.displacement_mm) <
      kOscillationSettings.reversal_steps * encoder_step_mm)
    return;
  end_half_cycle(encoder_step_mm, state);
  // the next half cycle began at the extremum of this one
  state.displacement_mm -= state.farthest_mm;
  state.time_s -= state.farthest_s;
  state.farthest_mm = state.displacement_mm;
  state.farthest_s = state.time_s;
  state.lateral_mm = {};
}

}  // namespace palpate
