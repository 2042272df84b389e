#pragma once

#include "surfaces/surface_block.h"

namespace palpate::internal {

/// Cells per stretch. A cell is the box between eight neighbouring voxels, identified by the lowest; a
/// stretch is a run of cells along i.
inline constexpr int kStretch = 32;
/// Stretches of a grid, as a box of (stretch, j, k).
Span3 stretches(const GridGeometry& grid);
/// Stretches with a cell that has a corner in a box of voxels.
Span3 stretches_at(const GridGeometry& grid, const Span3& voxels);

/// Squared upper bound, for each stretch of `slopes`, of the gradient magnitude of the trilinear interpolant
/// in its cells, per mm: within a cell the derivative along an axis lies between the differences along its
/// four edges.
/// @param position  steps of kSurfaceStep_mm; covers the cells' voxels as far as the grid extends
void bound_slopes(const GridGeometry& grid, const Block<std::int16_t>& position, Block<float>& slopes);

/// Maximum of the squares, 0 for none; and the same with a sub-box of stretches excluded.
float greatest(std::span<const float> slopes);
float max_outside(std::span<const float> slopes, const Span3& all, const Span3& without);
/// Slope bound that corresponds to a maximum square; at least 1e-6.
double steepest_of(float square);

}  // namespace palpate::internal
