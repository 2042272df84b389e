#pragma once

#include <array>
#include <optional>
#include <span>

#include "palpate/geometry/geometry.h"

namespace palpate {

/// Where a point may be: normal . q >= offset.
struct HalfSpace {
  Vector<Patient> normal;  ///< unit
  double offset = 0;       ///< mm

  /// How far inside q is; negative: outside.
  double clearance(const Point<Patient>& q) const { return normal.eigen().dot(q.eigen()) - offset; }
};
/// A corner of three walls, each of which may be met by every sphere of a tool.
inline constexpr std::size_t kMostHalfSpaces = 12;

/// The closest point to another that half-spaces leave, and what holds it there: the point is
/// x + sum of pull[i] * normal of half-space active[i], every pull above 0 mm.
struct ClosestPoint {
  Point<Patient> point;
  std::array<int, 3> active{};
  std::array<double, 3> pull_mm{};
  int count = 0;  ///< of active ones, 0 ... 3
};

/// The point nearest to x in all half-spaces, exactly: by the active set whose pulls are all positive and
/// whose point is in every other half-space (the Karush-Kuhn-Tucker conditions of a quadratic programme; in
/// three dimensions three are enough). Projecting onto one after the other is inexact in an acute wedge.
/// @param half_spaces  at most kMostHalfSpaces
/// @return nothing where no point is in all of them
std::optional<ClosestPoint> closest_point(const Point<Patient>& x, std::span<const HalfSpace> half_spaces);

}  // namespace palpate
