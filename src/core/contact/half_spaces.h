#pragma once

#include <array>
#include <optional>
#include <span>

#include "palpate/geometry/geometry.h"

namespace palpate {

/// Half-space of allowed points q: normal . q >= offset.
struct HalfSpace {
  Vector<Patient> normal;  ///< Inward direction of the half-space; unit
  double offset = 0;       ///< Offset along the normal

  /// Signed distance from the boundary plane, mm; negative: outside the half-space.
  double clearance(const Point<Patient>& q) const { return normal.eigen().dot(q.eigen()) - offset; }
};
/// Capacity of a constraint set: three active constraints (a corner) for each of kMaxToolParts tool parts.
inline constexpr std::size_t kMaxHalfSpaces = 12;

/// Projection of a point onto an intersection of half-spaces, with its active set and multipliers: point = x
/// + sum of multiplier_mm[i] * normal of half-space active[i], every multiplier_mm[i] > 0.
struct ClosestPoint {
  Point<Patient> point;
  std::array<int, 3> active{};
  std::array<double, 3> multiplier_mm{};
  int count = 0;  ///< Number of active half-spaces, 0 ... 3
};

/// Exact projection of x onto the intersection of half-spaces: enumerates active sets until all multipliers
/// are positive and the point is in every other half-space (the Karush-Kuhn-Tucker conditions of a quadratic
/// programme; in three dimensions at most three constraints are active). Cyclic projection would be inexact
/// in an acute wedge.
/// @param half_spaces  at most kMaxHalfSpaces
/// @return empty if the intersection is empty
std::optional<ClosestPoint> closest_point(const Point<Patient>& x, std::span<const HalfSpace> half_spaces);

}  // namespace palpate
