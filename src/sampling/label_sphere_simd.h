#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/sampling/voxel_methods.h"

namespace palpate::internal::label_sphere {

/// Labels or a mask as the vector code reads them: members are values in one of the ranges, 0 is none.
template <class T>
struct LabelGrid {
  BrickView<T> bricks;  ///< 0 around the grid
  int dims[3];
  const LabelRange* ranges;
  std::size_t range_count;
  /// X_VoxelPatient: its matrix, column by column, and its translation. The matrix's transpose takes
  /// gradients per voxel to gradients per mm.
  const double *voxel_per_mm, *origin;
};

/// A point in continuous voxel indices.
struct SpherePoint {
  double x[3];
};

/// The smooth sphere of two voxels along every axis, the smallest one.
struct SmallKernel {};

/// The smooth sphere's kernel along each axis.
struct SmoothKernel {
  double radius[3];     ///< voxels, 2 ... 64
  float per_radius[3];  ///< 1 / radius
  int count[3];         ///< voxels that can lie within the radius: 2 * radius, rounded up
};

/// The Gaussian sphere's weights over the fraction of x: row r holds those of fraction r/intervals - 1/2 for
/// the voxels -2 ... 2 around the nearest, with two zeros on either side and kStride floats to the next row.
struct GaussianTable {
  static constexpr int kIntervals = 512, kStride = 12;
  const float* rows;  ///< kIntervals + 1 of them
};

/// Both spheres are sums of separable weights over a box of voxels; the same bits on every target, and
/// whatever the number of points. Samples are written as four doubles each: value, gradient x, y, z per mm.
void sample_sphere(const LabelGrid<std::uint8_t>& grid, const SmoothKernel& kernel, const SpherePoint* points,
                   std::size_t count, double* samples);
void sample_sphere(const LabelGrid<std::uint16_t>& grid, const SmoothKernel& kernel,
                   const SpherePoint* points, std::size_t count, double* samples);
/// The same for points in the patient frame.
void sample_sphere(const LabelGrid<std::uint8_t>& grid, const SmallKernel& kernel,
                   const Point<Patient>* points, std::size_t count, double* samples);
void sample_sphere(const LabelGrid<std::uint16_t>& grid, const SmallKernel& kernel,
                   const Point<Patient>* points, std::size_t count, double* samples);
void sample_sphere(const LabelGrid<std::uint8_t>& grid, const GaussianTable& table, const SpherePoint* points,
                   std::size_t count, double* samples);
void sample_sphere(const LabelGrid<std::uint16_t>& grid, const GaussianTable& table,
                   const SpherePoint* points, std::size_t count, double* samples);

}  // namespace palpate::internal::label_sphere
