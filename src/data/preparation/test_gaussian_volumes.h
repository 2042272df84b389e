#pragma once

#include <cmath>
#include <random>

#include "palpate/preparation/preparation.h"

namespace palpate::internal {

inline GridGeometry test_grid(std::array<int, 3> dims, const Eigen::Vector3d& spacing_mm) {
  GridGeometry grid;
  grid.dims = dims;
  grid.spacing_mm = spacing_mm;
  return grid;
}

/// Random bytes with entire rows and slices of 0, as in a label map.
inline Volume<std::uint8_t> random_bytes(const GridGeometry& grid, std::mt19937& random) {
  Volume<std::uint8_t> volume(grid);
  std::uniform_int_distribution<int> level(0, 255), one_of_three(0, 2), one_of_four(0, 3);
  for (int k = 0; k < grid.dims[2]; ++k) {
    if (grid.dims[2] > 1 && one_of_four(random) == 0) continue;
    for (int j = 0; j < grid.dims[1]; ++j) {
      if (grid.dims[1] > 1 && one_of_three(random) == 0) continue;
      for (int i = 0; i < grid.dims[0]; ++i) volume.at(i, j, k) = static_cast<std::uint8_t>(level(random));
    }
  }
  return volume;
}

/// 0 or 255 independently for each voxel: the worst case for comparing two filters.
inline Volume<std::uint8_t> random_binary(const GridGeometry& grid, std::mt19937& random) {
  Volume<std::uint8_t> volume(grid);
  for (auto& voxel : volume.voxels()) voxel = (random() & 1) != 0 ? 255 : 0;
  return volume;
}

inline Volume<float> random_floats(const GridGeometry& grid, std::mt19937& random) {
  Volume<float> volume(grid);
  std::uniform_real_distribution<float> level(-1000, 1000);
  for (float& voxel : volume.voxels()) voxel = level(random);
  return volume;
}

/// 255 inside a sphere around the centre of the grid, otherwise 0.
inline Volume<std::uint8_t> binary_sphere(const GridGeometry& grid, double radius_mm) {
  Volume<std::uint8_t> volume(grid);
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const auto p = grid.X_PatientVoxel() * Point<Voxel>(i, j, k);
        volume.at(i, j, k) = (p - grid.centre()).norm() < radius_mm ? 255 : 0;
      }
    }
  }
  return volume;
}

}  // namespace palpate::internal
