#pragma once

#include "palpate/volume/gaussian_kernel.h"
#include "palpate/volume/gaussian_rows.h"
#include "surfaces/surface_block.h"

namespace palpate::internal {

/// Symmetric kernels along i, j, k; weights[t] applies to the voxels at distance t.
struct BlockKernel {
  std::array<AxisKernel, 3> axis;
  Index3 reach() const { return {axis[0].radius(), axis[1].radius(), axis[2].radius()}; }
};

/// Normalised Gaussian sampled at voxel centres, truncated at 2.5 sigma.
BlockKernel gaussian_block_kernel(const Eigen::Vector3d& spacing_mm, double sigma_mm);
/// Along each axis, twice a Gaussian of sigma minus one of sigma * sqrt(2). The second moment vanishes, so
/// quadratic functions are preserved and a sphere hardly shrinks. Truncated at 3 sigma.
BlockKernel quadratic_block_kernel(const Eigen::Vector3d& spacing_mm, double sigma_mm);

/// Operation that combines rows into one: sum_rows for a convolution, min_of_rows for a minimum.
using RowOperation = void (*)(const WeightedRows<float>& rows, std::size_t length, float* out);

/// Applies the operation along k, then j, then i; after the first step, slices that served only as neighbours
/// are dropped. `in` covers `out` and the kernel's reach around it. If each row that an output row depends on
/// is constant, the result is computed once instead of per voxel, which is the case for most surroundings of
/// a structure. The bits of a voxel depend only on its neighbourhood, not on block boundaries.
void filter_block(const Block<float>& in, const BlockKernel& kernel, RowOperation operation,
                  Block<float>& out);
/// Applies the operation along j, then i only, to data already filtered along k.
void filter_slices(const Block<float>& in, const BlockKernel& kernel, RowOperation operation,
                   Block<float>& out);
/// Convolution with the kernel.
void filter_block(const Block<float>& in, const BlockKernel& kernel, Block<float>& out);

}  // namespace palpate::internal
