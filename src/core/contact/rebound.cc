#include "palpate/contact/rebound.h"
#include "palpate/contact/contact_settings.h"

#include <algorithm>
#include <limits>

namespace palpate {

double limit_rebound_N(const ReboundInput& input, ReboundState& state) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  if (!state.touched) {
    state = {};
    state.touched = true;
    state.impact_mm_s = -input.speed_mm_s;
    return kNone;
  }
  if (state.impact_mm_s < kReboundSettings.min_steps_per_s * input.encoder_step_mm) return kNone;
  if (state.time_s >= kReboundSettings.max_contact_s) return kNone;

  // the force was constant during the tick
  state.impulse_integral_N_s2 += (state.impulse_N_s + 0.5 * input.acting_force_N * input.dt_s) * input.dt_s;
  state.impulse_N_s += input.acting_force_N * input.dt_s;
  state.time_s += input.dt_s;
  state.depth_mm -= input.displacement_mm;

  // lag behind unhindered motion, fitted against the double integral of the force
  const double lag_mm = state.impact_mm_s * state.time_s - state.depth_mm;
  state.sum_lag_impulse_N_s2_mm +=
      (lag_mm + kReboundSettings.quantisation_steps * input.encoder_step_mm) * state.impulse_integral_N_s2;
  state.sum_impulse_squared_N2_s4 += state.impulse_integral_N_s2 * state.impulse_integral_N_s2;
  if (lag_mm < kReboundSettings.min_deceleration_steps * input.encoder_step_mm ||
      !(state.sum_lag_impulse_N_s2_mm > 0))
    return kNone;

  // change of speed per impulse, mm/s per N s: 1000 over the apparent mass in kg
  const double inverse_mass_mm_s_per_N_s = state.sum_lag_impulse_N_s2_mm / state.sum_impulse_squared_N2_s4;
  const double out_mm_s =
      (state.impulse_N_s + std::max(0.0, input.pending_N_s)) * inverse_mass_mm_s_per_N_s - state.impact_mm_s;
  const double margin_mm_s = kReboundSettings.max_restitution * state.impact_mm_s - out_mm_s;
  return std::max(0.0, margin_mm_s) / (inverse_mass_mm_s_per_N_s * input.dt_s);
}

}  // namespace palpate
