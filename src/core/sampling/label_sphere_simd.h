#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/sampling/sphere_filters.h"

namespace palpate::internal::label_sphere {

/// Labels or a mask as read by the vector code. Members have a value in one of the ranges; 0 is never a
/// member.
template <class T>
struct LabelGrid {
  BrickView<T> bricks;  ///< Value 0 outside the grid
  int dims[3];
  const LabelRange* ranges;
  std::size_t range_count;
  /// X_VoxelPatient: its matrix in column-major order, and its translation. The transposed matrix maps
  /// gradients per voxel to gradients per mm.
  const double *voxel_per_mm, *origin;
};

/// Point in continuous voxel coordinates.
struct SpherePoint {
  double x[3];
};

/// Smooth sphere with a radius of two voxels along every axis, the smallest.
struct SmallKernel {};

/// Smooth sphere's kernel along each axis.
struct SmoothKernel {
  double radius[3];     ///< Kernel radius in voxels, 2 ... 64
  float per_radius[3];  ///< 1 / radius
  int count[3];         ///< Window size: 2 * radius, rounded up
};

/// Weights of the Gaussian sphere, tabulated over the fraction of x: row r has the weights at the fraction
/// `r / kIntervals - 1/2` for the voxels -2 ... 2 around the nearest, with two zeros on either side; rows are
/// kStride floats apart.
struct GaussianTable {
  static constexpr int kIntervals = 512, kStride = 12;
  const float* rows;  ///< kIntervals + 1 rows
};

/// Samples a sphere filter, a separable weighted sum over a box of voxels, at points in voxel coordinates.
/// Bit-identical on every target and for any number of points. Each sample is four doubles: value, gradient
/// x, y, z per mm.
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
