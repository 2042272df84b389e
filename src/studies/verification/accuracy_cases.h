#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "palpate/phantoms/primitives.h"

namespace palpate {

/// A solid with an analytic surface, for contact through voxels.
struct AccuracyCase {
  std::string name;
  Shape shape;
  double half_extent_mm;  ///< Half edge of the cube around the origin that a volume has to cover
  /// Within 0.75 mm of the surface, far from ends and from the volume's boundary
  std::vector<Point<Patient>> points;
  /// Exact Gaussian smoothing of the solid (1 inside, 0 outside) with that sigma.
  std::function<double(const Point<Patient>& p, double sigma_mm)> smoothed;
  bool with_paths = false;  ///< Whether choppiness is measured along paths on it
};

inline constexpr double kSurfaceBand_mm = 0.75;

/// Sphere of 20 mm, cylinder of 10 mm, oblique plane, torus of 20 and 8 mm; the latter three are oblique to
/// every axis. `points` random points each, the same in every call.
std::vector<AccuracyCase> accuracy_cases(int points);

struct AccuracySpacing {
  std::string name;  ///< Name, e.g. 0.28x0.28x1.0
  Eigen::Vector3d mm;
};
/// Thick slices, the voxel size of the original publication, fine voxels.
const std::array<AccuracySpacing, 3>& accuracy_spacings();

/// A grid around the origin, offset by fractions of a voxel so that no shape is favoured.
GridGeometry accuracy_grid(const AccuracyCase& shape, const Eigen::Vector3d& spacing_mm);

}  // namespace palpate
