#pragma once

#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "palpate/palpation/palpation.h"

namespace palpate {

struct SurfaceCandidate {
  SurfacePoint surface;
  double score = 0;  ///< Suitability for a press; positive
};

/// Voxel centres of a structure that border free space, excluding faces at which the scan ends.
std::vector<Point<Patient>> border_voxels(const Model& model, LabelId structure);

/// Surface points of a structure that suit a press, best first: flat, belonging to the structure, with free
/// space in front.
/// @param border  candidates: border_voxels() or a subset
std::vector<SurfaceCandidate> surface_candidates(const Model& model, LabelId structure,
                                                 std::span<const Point<Patient>> border, double clearance_mm);

/// Unit vectors perpendicular to a unit vector, at equal angles around it.
template <int kCount>
std::array<Vector<Patient>, kCount> directions_around(const Vector<Patient>& axis) {
  const Vector<Patient> helper =
      std::abs(axis.x()) < 0.7 ? Vector<Patient>(1, 0, 0) : Vector<Patient>(0, 1, 0);
  const Vector<Patient> u = axis.cross(helper).normalized(), v = axis.cross(u);
  std::array<Vector<Patient>, kCount> directions;
  for (int d = 0; d < kCount; ++d) {
    const double angle = d * 2 * std::numbers::pi / kCount;
    directions[static_cast<std::size_t>(d)] = u * std::cos(angle) + v * std::sin(angle);
  }
  return directions;
}

}  // namespace palpate
