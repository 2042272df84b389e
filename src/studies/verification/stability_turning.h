#pragma once

#include <cstdint>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

inline constexpr std::uint64_t kTurningSeed = 15;

/// Levers of up to 100 mm that a hand rotates at up to 20 rad/s through plates of 2 mm of any orientation,
/// with three voxel sizes, at 1 kHz and 250 Hz, with and without jitter, half of them with a shaft: maximum
/// penetration of any sphere, and of any point of a shaft, along the proxy's whole path, number of levers
/// that pass through, and number without contact; with limits. Deterministic. Errors: kInterrupted.
/// @param turns  total number of rotations, at least 1
Result<std::vector<Figure>> turning_figures(int turns, const Progress& progress);

}  // namespace palpate
