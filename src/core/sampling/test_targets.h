#pragma once

#include <hwy/targets.h>

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "palpate/volume/volume.h"

/// Test helpers shared by several modules: every SIMD target of the machine, and challenging grids and
/// points.
namespace palpate::test {

/// Restricts Highway to the given targets (0: the fallback only) for its lifetime.
class OnlyTargets {
 public:
  explicit OnlyTargets(std::int64_t targets) {
    hwy::SetSupportedTargetsForTest(targets);
    hwy::GetChosenTarget().Update(targets);
  }
  OnlyTargets(const OnlyTargets&) = delete;
  OnlyTargets& operator=(const OnlyTargets&) = delete;
  ~OnlyTargets() {
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().DeInit();
  }
};

/// Every target of the machine, and 0 for the fallback.
inline std::vector<std::int64_t> all_targets() {
  std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  targets.push_back(0);
  return targets;
}
inline std::string target_name(std::int64_t target) {
  return target == 0 ? "fallback" : hwy::TargetName(target);
}

/// Grids of increasing generality: unit, anisotropic, oblique, left-handed.
inline GridGeometry make_grid(std::array<int, 3> dims, int kind) {
  GridGeometry grid;
  grid.dims = dims;
  grid.origin = Point<Patient>(-12.5, 40, 7.25);
  if (kind >= 1) grid.spacing_mm = {0.28, 0.625, 1.0};
  if (kind >= 2) {
    grid.direction = Eigen::AngleAxisd(0.7, Eigen::Vector3d(-1, 2, 0.5).normalized()).toRotationMatrix();
  }
  if (kind >= 3) grid.direction.col(0) *= -1;
  return grid;
}

/// Points with NaN or infinite coordinates, or too far away for an integer index.
inline std::vector<Point<Patient>> invalid_points(const GridGeometry& grid) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  std::vector<Point<Patient>> points;
  for (const double bad : {nan, inf, -inf, 1e300, -1e300, 1e12, -1e12, 3e9, -3e9}) {
    for (int axis = 0; axis < 3; ++axis) {
      points.push_back(grid.centre());
      points.back()[axis] = bad;
    }
  }
  return points;
}

}  // namespace palpate::test
