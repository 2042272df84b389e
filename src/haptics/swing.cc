#include "palpate/haptics/swing.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double kLongestHalf_s = 0.075, kLeastSpeed_mm_s = 15;
constexpr double kLeastSteps = 5;      // of the encoder: a swing and no flicker
constexpr double kSwingTurnSteps = 2;  // so far back it has turned
constexpr double kKept = 0.75;         // of the half before: less, and it dies down
constexpr int kSwings = 3;
// out of contact for so long, and nothing is left of it
constexpr double kForgotten_s = 0.1;

// one half of a swing is over: from the turn before to the place farthest from it
void end_half(double step_mm, SwingState& state) {
  const double length_mm = std::abs(state.farthest_mm), time_s = state.farthest_s;
  const bool by_itself = length_mm >= std::max(kLeastSwing_mm, kLeastSteps * step_mm) &&
                         time_s <= kLongestHalf_s && length_mm >= kLeastSpeed_mm_s * time_s &&
                         state.aside_mm.norm() <= length_mm;
  const bool as_large = length_mm >= kKept * state.before_mm;
  state.halves = !by_itself ? 0 : as_large ? state.halves + 1 : 1;
  if (state.halves >= kSwings) state.later_s = std::min(kMostLater_s, state.later_s + kLater_s);
  state.before_mm = length_mm;
}

}  // namespace

void look_for_swing(const Vector<World>& force_N, const Vector<World>& way_mm, double step_mm, double dt_s,
                    SwingState& state) {
  state.later_s = std::max(0.0, state.later_s - kForgetLater * dt_s);
  const double force = force_N.norm();
  state.free_s = force > 0 ? 0 : state.free_s + dt_s;
  if (force > 0) state.axis = force_N / force;
  if (state.free_s > kForgotten_s) {
    const double later_s = state.later_s;
    state = {};
    state.later_s = later_s;
    state.free_s = kForgotten_s;
    return;
  }

  const double along_mm = way_mm.dot(state.axis);
  state.way_mm += along_mm;
  state.time_s += dt_s;
  state.aside_mm += way_mm - state.axis * along_mm;
  if (std::abs(state.way_mm) > std::abs(state.farthest_mm) && state.way_mm * state.farthest_mm >= 0) {
    state.farthest_mm = state.way_mm;
    state.farthest_s = state.time_s;
    return;
  }
  if (std::abs(state.farthest_mm - state.way_mm) < kSwingTurnSteps * step_mm) return;
  end_half(step_mm, state);
  // the next one began where this one was farthest
  state.way_mm -= state.farthest_mm;
  state.time_s -= state.farthest_s;
  state.farthest_mm = state.way_mm;
  state.farthest_s = state.time_s;
  state.aside_mm = {};
}

}  // namespace palpate
