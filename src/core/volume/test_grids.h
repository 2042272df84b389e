#pragma once

#include <vector>

#include "palpate/volume/volume.h"

/// Grids that break code which assumes axis-aligned, right-handed or isotropic grids.
namespace palpate::testing {

inline GridGeometry grid(std::array<int, 3> dims, Eigen::Vector3d spacing_mm, Eigen::Matrix3d direction,
                         Point<Patient> origin) {
  GridGeometry g;
  g.dims = dims;
  g.spacing_mm = spacing_mm;
  g.direction = direction;
  g.origin = origin;
  return g;
}

inline Eigen::Matrix3d oblique() {
  return (Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitX()) *
          Eigen::AngleAxisd(-0.7, Eigen::Vector3d::UnitZ()))
      .toRotationMatrix();
}

inline Eigen::Matrix3d permuted() {
  Eigen::Matrix3d m;
  m << 0, 0, -1, 1, 0, 0, 0, -1, 0;
  return m;
}

inline Eigen::Matrix3d left_handed() {
  return Eigen::Vector3d(1, -1, 1).asDiagonal();
}

// gantry tilt: axes that are not orthogonal
inline Eigen::Matrix3d sheared() {
  Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
  m.col(2) = Eigen::Vector3d(0, 0.3, 1).normalized();
  return m;
}

inline std::vector<GridGeometry> awkward_grids(std::array<int, 3> dims) {
  const Eigen::Vector3d spacing(0.7, 1.3, 2.5);
  const Point<Patient> origin(-31.5, 12.25, 104);
  return {grid(dims, spacing, Eigen::Matrix3d::Identity(), origin),
          grid(dims, spacing, oblique(), origin),
          grid(dims, spacing, permuted(), origin),
          grid(dims, spacing, left_handed(), origin),
          grid(dims, spacing, oblique() * left_handed(), origin),
          grid(dims, spacing, sheared(), origin)};
}

}  // namespace palpate::testing
