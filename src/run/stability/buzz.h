#pragma once

#include <span>

#include "palpate/stability/hold.h"

namespace palpate {

/// Computes the residual motion from tip positions at each tick and from the forces between consecutive
/// ticks, in a common frame.
/// @param tip_mm   at least 2; one more than forces
Buzz buzz_of(std::span<const Eigen::Vector3d> tip_mm, std::span<const Eigen::Vector3d> force_N,
             double rate_hz);

}  // namespace palpate
