#pragma once

#include "palpate/stability/stability.h"

namespace palpate {

/// A wall touched at a speed and held, second after second, by the simulated hand and device.
///
/// The wall is the half-space below the device's origin along x. The hand comes down on it evenly and stops
/// wanting to go deeper where its spring and the wall's balance at 1 N; there the hold begins.
class WallHold {
 public:
  /// @param impact_m_s  0: the tip rests on the surface and the hand begins to press
  WallHold(const StabilityCase& held, double stiffness_N_per_mm, double impact_m_s);

  /// Holds for another second: the true tip's peak-to-peak in it.
  double next_swing_mm();
  /// What the servo commands now.
  double wall_force_N() const;

 private:
  void tick();

  const double dt_s_, stiffness_N_per_mm_;
  SimulatedDevice device_;
  double intended_mm_ = 0;
};

/// The longest hold that tells a limit cycle from a swing that dies down.
inline constexpr int kLongestHold_s = 10;

/// Whether the swing stays above two encoder steps: it does not get less from one second to the next, or is
/// still there after kLongestHold_s.
bool has_limit_cycle(const StabilityCase& held, double stiffness_N_per_mm, double impact_m_s);
/// Whether the swing is above two encoder steps in the second second of the hold, dying down or not.
bool swings_after_a_second(const StabilityCase& held, double stiffness_N_per_mm, double impact_m_s);

}  // namespace palpate
