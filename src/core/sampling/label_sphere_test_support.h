#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "palpate/sampling/sphere_filters.h"
#include "palpate/sampling/stored_normals.h"
#include "sampling/test_targets.h"

// Helpers of the tests of the label methods.
namespace palpate::internal {

/// Clusters of the labels 0 ... 5 and 40 000: each voxel has a random label or its neighbour's.
inline std::shared_ptr<const Bricks<LabelId>> random_labels(const GridGeometry& grid, std::mt19937& random) {
  Volume<LabelId> labels(grid);
  LabelId last = 0;
  for (LabelId& voxel : labels.voxels()) {
    if (random() % 4 == 0) last = static_cast<LabelId>(random() % 7 == 6 ? 40000 : random() % 6);
    voxel = last;
  }
  return label_bricks(labels);
}

/// A ball of label 1.
inline std::shared_ptr<const Bricks<LabelId>> ball_labels(const GridGeometry& grid,
                                                          const Point<Patient>& centre, double radius_mm) {
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const double distance = (X_PatientVoxel * Point<Voxel>(i, j, k) - centre).norm();
        labels.at(i, j, k) = distance < radius_mm ? 1 : 0;
      }
    }
  }
  return label_bricks(labels);
}

/// Points in and around the grid, including integer and half-integer voxel coordinates.
inline std::vector<Point<Patient>> random_points(const GridGeometry& grid, double beyond_voxels, int count,
                                                 std::mt19937& random) {
  std::vector<Point<Patient>> points;
  for (int n = 0; n < count; ++n) {
    Point<Voxel> x;
    for (int axis = 0; axis < 3; ++axis) {
      x[axis] =
          std::uniform_real_distribution<double>(-beyond_voxels, grid.dims[axis] - 1 + beyond_voxels)(random);
      const auto snap = random() % 8;
      if (snap == 0) x[axis] = std::round(x[axis]);
      if (snap == 1) x[axis] = std::floor(x[axis]) + 0.5;
    }
    points.push_back(grid.X_PatientVoxel() * x);
  }
  return points;
}

/// The founding force at a full force of 1: value times normal.
inline Vector<Patient> unit_force(const FieldSample& sample) {
  return sample.gradient.normalized() * -sample.value;
}

/// Smooth random path at a constant distance from a centre, in steps of `step_mm`.
inline std::vector<Point<Patient>> winding_path(const Point<Patient>& centre, double radius_mm,
                                                double step_mm, int count, std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::Vector3d out = Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
  Eigen::Vector3d along = out.unitOrthogonal();
  const double turns = std::uniform_real_distribution<double>(0, 2 * std::numbers::pi)(random);
  std::vector<Point<Patient>> path;
  for (int n = 0; n < count; ++n) {
    path.push_back(centre + Vector<Patient>(out * radius_mm));
    // curvature up to 1/2 per mm, varying over 3 mm
    const double turn = 0.5 * step_mm * std::sin(turns + n * step_mm / 3);
    along = (along + turn * out.cross(along)).normalized();
    const Eigen::Vector3d next = (out + along * (step_mm / radius_mm)).normalized();
    along = (along - along.dot(next) * next).normalized();
    out = next;
  }
  return path;
}

/// Changes of the force between successive points of a path.
struct Choppiness {
  std::vector<double> change_percent;  ///< in percent of the full force
  double quantile(double part) const {
    std::vector<double> sorted = change_percent;
    std::sort(sorted.begin(), sorted.end());
    return sorted[static_cast<std::size_t>(part * static_cast<double>(sorted.size() - 1))];
  }
};

template <class Method>
Choppiness choppiness(const Method& method, const std::vector<Point<Patient>>& path) {
  std::vector<FieldSample> samples(path.size());
  method.sample(path, samples);
  Choppiness result;
  for (std::size_t n = 1; n < samples.size(); ++n) {
    result.change_percent.push_back(100 * (unit_force(samples[n]) - unit_force(samples[n - 1])).norm());
  }
  return result;
}

}  // namespace palpate::internal
