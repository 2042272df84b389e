#pragma once

#include <algorithm>
#include <span>

#include "palpate/contact/proxy.h"
#include "palpate/sampling/surface.h"

/// Capsule represented by a row of spheres. The spacing is chosen so that between two spheres the outline is
/// at most ProxySettings::max_row_gap_mm inside the capsule's, even against a sharp edge across the axis;
/// thin capsules have a spacing of ProxySettings::min_row_pitch_mm. A tapered capsule has the spacing of its
/// thin end throughout.
namespace palpate {

/// Number of intervals between the spheres of the row; 0 for a sphere.
int row_steps(const ToolPart& part);

/// Whether any part of the tool is a capsule.
inline bool has_capsules(std::span<const ToolPart> parts) {
  return std::any_of(parts.begin(), parts.end(),
                     [](const ToolPart& part) { return part.axis_mm != Vector<Patient>(); });
}

/// Nearest sphere of a row.
struct NearestInRow {
  /// Signed distance of that sphere's centre, minus the increase of its radius over the first sphere's; mm.
  double distance_mm = 0;
  int step = 0;  ///< Index of the sphere, 0 ... row_steps
};

/// Nearest sphere of a row to a surface. If none is nearer than `cutoff_mm`, distance_mm may be any lower
/// bound above that. Branch and bound by bisection of the row: along it the distance changes at most by the
/// surface's maximum slope, and the radius linearly. Does not allocate, lock or throw.
/// @param centre   centre of the row's first sphere
/// @param shape    capsule, gives the axis from there
/// @param steps    row_steps() of the capsule
/// @param begin    step evaluated first; the last known nearest one saves queries
/// @param queries  incremented by the number of surface queries
NearestInRow nearest_in_row(const Surface& surface, const Point<Patient>& centre, const ToolPart& shape,
                            int steps, int begin, double cutoff_mm, int& queries);

/// Middle of the interval of a row that touches a surface together with one step, 0 ... 1 along the axis:
/// mean of the adjacent steps whose distance differs by less than `beside_mm`, weighted linearly by that
/// difference.
double middle_of_touching(const Surface& surface, const Point<Patient>& centre, const ToolPart& shape,
                          int steps, int step, double beside_mm, int& queries);

}  // namespace palpate
