#pragma once

#include <span>

#include "palpate/stability/hold.h"

namespace palpate {

/// Of the tip's positions, one each tick, and the forces that acted from each to the next, in one frame.
/// @param tip_mm   at least 2; one more than forces
Buzz buzz_of(std::span<const Eigen::Vector3d> tip_mm, std::span<const Eigen::Vector3d> force_N,
             double rate_hz);

}  // namespace palpate
