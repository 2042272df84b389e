#pragma once

#include "palpate/geometry/geometry.h"

namespace palpate {

/// What tells a hand that swings by itself.
struct SwingState {
  Vector<World> axis;             ///< of the last force
  double way_mm = 0, time_s = 0;  ///< along it since the last turn
  double farthest_mm = 0, farthest_s = 0;
  Vector<World> aside_mm;  ///< likewise, to the sides
  double before_mm = 0;    ///< length of the half swing before
  int halves = 0;          ///< of a swing by itself, one after the other
  double free_s = 0;       ///< out of contact
  double later_s = 0;      ///< that the force is taken to act later than is known
};

/// Looks for a hand that swings by itself against what it touches, whoever it is, and says how much later
/// than is known the force must be taken to act: what keeps it swinging is energy that the observer does not
/// see.
///
/// A swing by itself goes to and fro along the force, three times running and not less each time, faster
/// than 6.7 Hz, by at least SwingFeel::least_mm and 15 mm/s in the mean, and not farther aside than to and
/// fro. A finger taps more slowly, a tremor of 8 to 12 Hz moves by less, and whoever slides over ribs goes
/// aside.
/// @param force_N  asked; zero in free space
/// @param way_mm   of the tip since the last tick, relative to the object, mm of the device
/// @param step_mm  of the encoders
void look_for_swing(const Vector<World>& force_N, const Vector<World>& way_mm, double step_mm, double dt_s,
                    SwingState& state);

}  // namespace palpate
