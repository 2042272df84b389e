#include "servo/passivity.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// an encoder without a known step counts as one that is coarse among those that are known
constexpr double kCoarseStep_mm = 0.06;
// A way of one step tells no speed: it may be the encoder's own. One for which the tip needs longer is rest.
constexpr double kTellingSteps = 1.5, kLongest_s = 0.007;
// what stays covered: as much as the encoder hides (F 2 steps, methods of Hannaford & Ryu with quantisation)
constexpr double kReserveSteps = 2;

// speed along the force, from the shortest way that tells one; none after a turn
void follow_speed(double along_mm, double step_mm, double dt_s, PassivityState& state) {
  if (along_mm * state.speed_mm_s < 0 && std::abs(along_mm) > 0.5 * step_mm)
    state.speed_mm_s = state.way_mm = state.time_s = 0;
  state.way_mm += along_mm;
  state.time_s += dt_s;
  const bool told = std::abs(state.way_mm) >= kTellingSteps * step_mm;
  if (!told && state.time_s < kLongest_s) return;
  state.speed_mm_s = told ? state.way_mm / state.time_s : 0;
  state.way_mm = state.time_s = 0;
}

}  // namespace

PassivityOutput keep_passive(const PassivityInput& input, bool act, PassivityState& state) {
  // what flowed in; no more of it is there than the contact can hold
  state.energy_mJ = std::min(state.energy_mJ - input.sent_N.dot(input.way_mm), input.stored_mJ);

  // in free space nothing is left but what is owed
  const double force_N = input.force_N.norm();
  if (!(force_N > 0) || !(input.dt_s > 0)) {
    state = {std::min(state.energy_mJ, 0.0), 0, 0, 0};
    return {};
  }

  // what the force would give out, if the tip went on as it does
  const double step_mm = input.step_mm > 0 ? input.step_mm : kCoarseStep_mm;
  follow_speed(input.way_mm.dot(input.force_N) / force_N, step_mm, input.dt_s, state);
  if (!act || state.speed_mm_s <= 0) return {};
  const double way_mm = state.speed_mm_s * input.dt_s;
  const double missing_mJ = force_N * (way_mm + kReserveSteps * step_mm) - state.energy_mJ;
  if (missing_mJ <= 0) return {};

  // a damper that takes it off within the tick, as far as it may
  constexpr double kMillimetresPerMetre = 1e3;
  PassivityOutput out;
  out.damping_N_s_per_m =
      std::min(kMostDamping_N_s_per_m, missing_mJ / (way_mm * state.speed_mm_s) * kMillimetresPerMetre);
  const double less_N = out.damping_N_s_per_m * state.speed_mm_s / kMillimetresPerMetre;
  out.factor = std::max(0.0, 1 - less_N / force_N);
  return out;
}

}  // namespace palpate
