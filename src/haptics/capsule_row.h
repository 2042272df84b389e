#pragma once

#include <algorithm>
#include <span>

#include "palpate/haptics/proxy.h"
#include "palpate/sampling/surface.h"

/// A capsule as a row of spheres. They are so near to each other that a wall which lies across stands at most
/// ProxyFeel::row_dip_mm above the capsule's outline between two of them, even where it is as sharp as an
/// edge; thin capsules and points are felt every ProxyFeel::least_pitch_mm. One that widens has all of them
/// as near to each other as at its thin end.
namespace palpate {

/// From one sphere to the next there are so many steps; 0 of a sphere alone.
int row_steps(const ToolSphere& sphere);

/// Whether any part of a tool is a capsule.
inline bool has_capsules(std::span<const ToolSphere> spheres) {
  return std::any_of(spheres.begin(), spheres.end(),
                     [](const ToolSphere& sphere) { return sphere.along_mm != Vector<Patient>(); });
}

struct NearestInRow {
  /// Of the sphere's centre, in the surface's own measure, less what it is wider than the first one.
  double distance_mm = 0;
  int step = 0;  ///< of the sphere, 0 ... row_steps
};

/// The sphere of a row that is nearest to a surface, or, where none is nearer than `enough_mm`, a lower bound
/// of all distances above that. Found by halving the row: along it a distance changes no faster than the
/// surface is steep, and the radius evenly. Allocates, locks and throws nothing.
/// @param centre  of the row's first sphere
/// @param shape   says how the row goes on from there
/// @param begin   a step to begin with: the nearest one of a moment ago saves looks
/// @param looks   counts how often the surface was asked
NearestInRow nearest_in_row(const Surface& surface, const Point<Patient>& centre, const ToolSphere& shape,
                            int steps, int begin, double enough_mm, int& looks);

/// The middle of the part of a row that lies on a surface with the sphere of one step, as its share of the
/// row, 0 ... 1: what touches beside it to within `beside_mm`, weighted by how near it is.
double middle_of_touching(const Surface& surface, const Point<Patient>& centre, const ToolSphere& shape,
                          int steps, int step, double beside_mm, int& looks);

}  // namespace palpate
