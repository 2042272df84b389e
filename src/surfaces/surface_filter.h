#pragma once

#include "palpate/volume/gaussian_kernel.h"
#include "palpate/volume/gaussian_rows.h"
#include "surfaces/surface_block.h"

namespace palpate::internal {

/// Kernels along i, j, k; each symmetric, weights[t] belongs to the voxels at distance t.
struct BlockKernel {
  std::array<AxisKernel, 3> axis;
  Index3 reach() const { return {axis[0].radius(), axis[1].radius(), axis[2].radius()}; }
};

/// A Gaussian sampled at whole voxels as far as 2.5 sigma, and normalised.
BlockKernel gaussian_block_kernel(const Eigen::Vector3d& spacing_mm, double sigma_mm);
/// Twice a Gaussian of sigma less one of sigma * sqrt(2), along each axis: no second moment, so that the
/// filter leaves quadratic functions as they are and a sphere hardly shrinks. As far as 3 sigma.
BlockKernel quadratic_block_kernel(const Eigen::Vector3d& spacing_mm, double sigma_mm);

/// How rows become one: sum_rows for a convolution, least_of_rows for what is least.
using RowOperation = void (*)(const WeightedRows<float>& rows, std::size_t length, float* out);

/// The operation along k, then j, then i: of the slices that are only there for their neighbours none is left
/// after the first. `in` covers `out` and the kernel's reach around it. Where all rows that an output row
/// needs hold one value each it is computed once and not for every voxel: most of the surroundings of a
/// structure are like that. A voxel's bits depend on its neighbourhood alone, and not on
/// where the blocks begin and end.
void filter_block(const Block<float>& in, const BlockKernel& kernel, RowOperation operation,
                  Block<float>& out);
/// The operation along j, then i alone: of what has been filtered along k.
void filter_slices(const Block<float>& in, const BlockKernel& kernel, RowOperation operation,
                   Block<float>& out);
/// The convolution.
void filter_block(const Block<float>& in, const BlockKernel& kernel, Block<float>& out);

}  // namespace palpate::internal
