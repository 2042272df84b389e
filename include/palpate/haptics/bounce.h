#pragma once

namespace palpate {

/// A tip that came out of free space against something, since it touched. Lengths and speeds along the force,
/// inwards positive, mm of the device.
struct BounceState {
  bool touched = false;
  double fell_mm_s = 0;             ///< as fast as it came
  double time_s = 0, depth_mm = 0;  ///< since the first tick of contact
  double push_N_s = 0;              ///< of the force that has acted since then
  double pushed_N_s2 = 0;  ///< its integral: a mass that nothing else moves is held back by that over it
  // sums for the line through the origin that says by how much per N s^2 the tip was held back
  double back_N_s2_mm = 0, squares_N2_s4 = 0;
};

struct BounceInput {
  double acted_N = 0;      ///< since the tick before, along the force that is asked
  double along_mm = 0;     ///< way of the tip since then, outwards
  double speed_mm_s = 0;   ///< mean of the last 10 ms, outwards
  double step_mm = 0;      ///< of the encoders
  double pending_N_s = 0;  ///< along the force: sent and not acted yet
  double dt_s = 0;
};

/// The most force that does not throw a tip out faster than the part BounceFeel::most_out of the speed with
/// which it came; infinite where nothing says that it would.
///
/// An account of energy is too slow for that: a light tip turns within two ticks on a stiff wall, an encoder
/// shows its turn a step later, and what was sent still acts after a delay. But while it is held back it
/// shows what it weighs: F of which one knows when it acted, and the way that it fell short of. So one knows
/// how fast it will be when what has been sent has acted. A hand that presses weighs much in that sense, and
/// is let alone.
double most_without_a_throw_N(const BounceInput& input, BounceState& state);

}  // namespace palpate
