#pragma once

#include <cstdint>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Number of trials.
struct ContactEffort {
  int planes = 40;         ///< Planes of random orientation: friction, and tremor on every fourth of them
  int turns = 8;           ///< Axes about which the object rotates while the tip sticks
  double sticking_s = 10;  ///< Duration of each
  int presses = 2000;      ///< Presses over all structures, at least one on each
  double voxel_mm = 0.6;   ///< Voxel size of the generated knee
  int levers = 300;        ///< Levers rotated through plates
};
inline constexpr std::uint64_t kContactSeed = 5;

/// Properties of the proxy: error of the friction coefficients, drift while sticking, and maximum penetration
/// of its path below a structure that is pressed or into which a tool is rotated; with limits. Deterministic.
/// Errors: kInterrupted.
Result<std::vector<Figure>> contact_figures(const Progress& progress, const ContactEffort& effort = {});

}  // namespace palpate
