#pragma once

#include <functional>
#include <random>

#include "palpate/surfaces/surfaces.h"

namespace palpate::test {

inline constexpr LabelId kTissue = 7;

inline GridGeometry surface_grid(const std::array<int, 3>& dims, const Eigen::Vector3d& spacing_mm) {
  GridGeometry grid;
  grid.dims = dims;
  grid.spacing_mm = spacing_mm;
  return grid;
}

/// Labels with kTissue where a voxel's centre, in mm, is inside.
inline Volume<LabelId> label_where(const GridGeometry& grid,
                                   const std::function<bool(const Eigen::Vector3d&)>& inside) {
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        if (inside((grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen())) labels.at(i, j, k) = kTissue;
      }
    }
  }
  return labels;
}

/// Volume large enough for a ball, with its centre at random within a voxel of the middle.
struct RandomBall {
  RandomBall(double radius, const Eigen::Vector3d& spacing_mm, std::mt19937& random) : radius_mm(radius) {
    std::uniform_real_distribution<double> within(-0.5, 0.5);
    std::array<int, 3> dims;
    for (int a = 0; a < 3; ++a) {
      const int half = static_cast<int>(std::ceil(radius / spacing_mm[a])) + 1;
      dims[a] = 2 * half + 1;
      centre[a] = (half + within(random)) * spacing_mm[a];
    }
    labels = label_where(surface_grid(dims, spacing_mm), [&](const Eigen::Vector3d& p) {
      return (p - centre).squaredNorm() < radius * radius;
    });
  }

  double radius_mm;
  Eigen::Vector3d centre;
  Volume<LabelId> labels;
};

inline Eigen::Vector3d random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

/// First zero crossing of the position along a ray: s in 0 ... length at start + s * direction.
inline double crossing(const Surface& surface, const Eigen::Vector3d& start, const Eigen::Vector3d& direction,
                       double length) {
  const auto at = [&](double s) { return surface.distance_mm(Point<Patient>(start + s * direction)); };
  const bool side = at(0) > 0;
  double low = 0;
  while (low < length && (at(low + 0.02) > 0) == side) low += 0.02;
  double high = low + 0.02;
  for (int n = 0; n < 30; ++n) {
    const double midpoint = 0.5 * (low + high);
    ((at(midpoint) > 0) == side ? low : high) = midpoint;
  }
  return low;
}

inline double angle_deg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / 3.14159265358979323846;
}

/// Mean and percentiles of measured values.
struct Spread {
  explicit Spread(std::vector<double> measured) : values(std::move(measured)) {
    std::sort(values.begin(), values.end());
    for (const double v : values) mean += v / static_cast<double>(values.size());
  }
  double at(double fraction) const {
    return values[std::min(values.size() - 1,
                           static_cast<std::size_t>(fraction * static_cast<double>(values.size())))];
  }
  std::vector<double> values;
  double mean = 0;
};

}  // namespace palpate::test
