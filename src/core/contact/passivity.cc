#include "palpate/contact/passivity.h"
#include "palpate/contact/contact_settings.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// velocity along the force, from the shortest displacement that allows an estimate; reset on reversal
void update_speed(double along_mm, double encoder_step_mm, double dt_s, PassivityState& state) {
  if (along_mm * state.speed_mm_s < 0 && std::abs(along_mm) > 0.5 * encoder_step_mm)
    state.speed_mm_s = state.displacement_mm = state.time_s = 0;
  state.displacement_mm += along_mm;
  state.time_s += dt_s;
  const bool is_measurable =
      std::abs(state.displacement_mm) >= kPassivitySettings.min_velocity_steps * encoder_step_mm;
  if (!is_measurable && state.time_s < kPassivitySettings.at_rest_s) return;
  state.speed_mm_s = is_measurable ? state.displacement_mm / state.time_s : 0;
  state.displacement_mm = state.time_s = 0;
}

// direction of the last motion along the force, at any speed
void update_direction(double along_mm, double encoder_step_mm, PassivityState& state) {
  const double half_mm = 0.5 * kPassivitySettings.reversal_steps * encoder_step_mm;
  state.dead_band_mm += along_mm;
  if (std::abs(state.dead_band_mm) < half_mm) return;
  state.moves_with_force = state.dead_band_mm > 0;
  state.dead_band_mm = std::copysign(half_mm, state.dead_band_mm);
}

// Factor for the contact stiffness while the energy is negative.
double softening_factor(const PassivityInput& input, double encoder_step_mm, const PassivityState& state) {
  const double step_N = input.stiffness_N_per_mm * encoder_step_mm;
  if (state.energy_mJ >= 0 || step_N <= kPassivitySettings.max_deficit_step_N) return 1;
  return std::max(kPassivitySettings.max_deficit_step_N / step_N,
                  1 + state.energy_mJ / (step_N * encoder_step_mm));
}

// Limit of the damping. A delayed damper makes a light tip oscillate, and the zero-order hold adds half a
// tick of mean delay.
double max_damping_N_s_per_m(const PassivityInput& input) {
  return std::min(kPassivitySettings.max_damping_N_s_per_m,
                  kPassivitySettings.max_damping_times_delay_kg / (input.delay_s + 0.5 * input.dt_s));
}

// Factor for the force with a damper that removes the energy not covered in this tick, within the damping
// limit.
double damping_factor(const PassivityInput& input, double force_N, double encoder_step_mm,
                      const PassivityState& state, double& damping_N_s_per_m) {
  if (state.speed_mm_s <= 0) return 1;
  constexpr double kMillimetresPerMetre = 1e3;
  const double displacement_mm = state.speed_mm_s * input.dt_s;
  const double missing_mJ = force_N * (displacement_mm + kPassivitySettings.reserve_steps * encoder_step_mm) +
                            std::max(0.0, input.pending_N_s) * state.speed_mm_s - state.energy_mJ;
  if (missing_mJ <= 0) return 1;
  damping_N_s_per_m = std::min(max_damping_N_s_per_m(input),
                               missing_mJ / (displacement_mm * state.speed_mm_s) * kMillimetresPerMetre);
  return std::max(0.0, 1 - damping_N_s_per_m * state.speed_mm_s / (kMillimetresPerMetre * force_N));
}

// Factor for the force during withdrawal where the energy does not cover the reserve, so that an energy
// deficit is also removed in motions too slow for the damper. The reduction is limited to the force of one
// encoder step, which is below the force flicker of the encoder itself.
double withdrawal_factor(double force_N, double stiffness_N_per_mm, double encoder_step_mm,
                         const PassivityState& state) {
  if (!state.moves_with_force) return 1;
  const double missing =
      std::max(0.0, 1 - state.energy_mJ / (force_N * kPassivitySettings.reserve_steps * encoder_step_mm));
  return 1 - std::min({missing, kPassivitySettings.max_hysteresis,
                       stiffness_N_per_mm * encoder_step_mm / force_N});
}

}  // namespace

PassivityOutput control_passivity(const PassivityInput& input, bool act, PassivityState& state) {
  // energy put in, limited to what the contact can store
  state.energy_mJ = std::min(
      state.energy_mJ - input.acting_force_N.dot(input.displacement_mm) + input.received_mJ, input.stored_mJ);

  // in free space only a negative energy is retained
  const double force_N = input.force_N.norm();
  if (!(force_N > 0) || !(input.dt_s > 0)) {
    const double owed_mJ = std::min(state.energy_mJ, 0.0);
    state = {};
    state.energy_mJ = owed_mJ;
    return {};
  }

  const double encoder_step_mm =
      input.encoder_step_mm > 0 ? input.encoder_step_mm : kPassivitySettings.default_step_mm;
  const double along_mm = input.displacement_mm.dot(input.force_N) / force_N;
  update_speed(along_mm, encoder_step_mm, input.dt_s, state);
  update_direction(along_mm, encoder_step_mm, state);
  const Vector<World> out = input.force_N / force_N;
  const double max_N = limit_rebound_N({input.acting_force_N.dot(out), along_mm, input.velocity_mm_s.dot(out),
                                        encoder_step_mm, input.pending_N_s, input.dt_s},
                                       state.rebound);
  if (!act) return {};

  const double soft = softening_factor(input, encoder_step_mm, state);
  const double soft_N = std::min(force_N, soft * input.unlimited_N);
  PassivityOutput output;
  output.factor =
      soft_N / force_N *
      std::min(damping_factor(input, soft_N, encoder_step_mm, state, output.damping_N_s_per_m),
               withdrawal_factor(soft_N, soft * input.stiffness_N_per_mm, encoder_step_mm, state));
  output.factor = std::min(output.factor, max_N / force_N);
  return output;
}

}  // namespace palpate
