#pragma once

#include "palpate/stability/stability.h"

namespace palpate {

/// Virtual wall that is touched at a speed and held, second by second, by the simulated hand and device.
///
/// The wall is the half-space below the device's origin along x. The hand approaches at constant speed and
/// stops where its spring and the wall's balance at 1 N; there the hold begins.
class WallHold {
 public:
  /// @param impact_m_s  0: the tip rests on the surface and the hand begins to press
  WallHold(const StabilityCase& stability_case, double stiffness_N_per_mm, double impact_m_s);

  /// Simulates another second; returns the true tip's peak-to-peak amplitude in it.
  double next_amplitude_mm();
  /// Force that the servo currently commands.
  double wall_force_N() const;

 private:
  void tick();

  const double dt_s_, stiffness_N_per_mm_;
  SimulatedDevice device_;
  double intended_mm_ = 0;
};

/// Longest hold by which a limit cycle is distinguished from a decaying oscillation.
inline constexpr int kMaxHold_s = 10;

/// Whether the amplitude stays above two encoder steps: it does not decrease from one second to the next, or
/// persists after kMaxHold_s.
bool has_limit_cycle(const StabilityCase& stability_case, double stiffness_N_per_mm, double impact_m_s);
/// Whether the amplitude exceeds two encoder steps in the second second of the hold, decaying or not.
bool oscillates_after_a_second(const StabilityCase& stability_case, double stiffness_N_per_mm,
                               double impact_m_s);

}  // namespace palpate
