#pragma once

#include <cstdint>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

inline constexpr std::uint64_t kTurningSeed = 15;

/// Levers of up to 100 mm that a hand turns at up to 20 rad/s through plates of 2 mm, of any tilt, on three
/// kinds of voxels, at 1 kHz and 250 Hz, punctual and not, half of them with a shaft: how deep any sphere,
/// and any place of a shaft, lies on the proxy's whole way, how many come out on the other side, how many are
/// not felt; with limits. The same in every run. Errors: kInterrupted.
/// @param turns  in all, at least 1
Result<std::vector<Figure>> turning_figures(int turns, const Progress& progress);

}  // namespace palpate
