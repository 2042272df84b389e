#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "palpate/phantoms/primitives.h"

namespace palpate {

/// A solid whose surface is known exactly, to be felt through voxels.
struct AccuracyCase {
  std::string name;
  Shape shape;
  double half_extent_mm;  ///< of the cube around the origin that a volume must cover
  std::vector<Point<Patient>>
      points;  ///< within 0.75 mm of the surface, far from ends and from the volume's border
  /// What a perfect Gaussian filter of that sigma makes of the solid (1 inside, 0 outside).
  std::function<double(const Point<Patient>& p, double sigma_mm)> smoothed;
  bool with_paths = false;  ///< choppiness is measured along paths on it
};

inline constexpr double kSurfaceBand_mm = 0.75;

/// Sphere of 20 mm, cylinder of 10 mm, tilted plane, torus of 20 and 8 mm, the latter three tilted against
/// every axis. `points` random ones each, the same at every call.
std::vector<AccuracyCase> accuracy_cases(int points);

struct AccuracySpacing {
  std::string name;  ///< 0.28x0.28x1.0
  Eigen::Vector3d mm;
};
/// Thick slices, the founding work's voxels, fine ones.
const std::array<AccuracySpacing, 3>& accuracy_spacings();

/// A grid around the origin, off it by fractions of a voxel so that no shape is favoured.
GridGeometry accuracy_grid(const AccuracyCase& shape, const Eigen::Vector3d& spacing_mm);

}  // namespace palpate
