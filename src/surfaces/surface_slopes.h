#pragma once

#include "surfaces/surface_block.h"

namespace palpate::internal {

/// A cell is the box between eight neighbouring voxels, named by its lowest; a stretch is 32 cells along i.
inline constexpr int kStretch = 32;
/// The stretches of a grid, as a box of (stretch, j, k).
Span3 stretches(const GridGeometry& grid);
/// Those with a cell that has a voxel in a box.
Span3 stretches_at(const GridGeometry& grid, const Span3& voxels);

/// For each stretch of `slopes` the square of a bound on the slope of the trilinear interpolant in its cells,
/// per mm: in a cell the derivative along an axis lies between the differences along its four edges.
/// @param position  steps of kSurfaceStep_mm; covers the cells' voxels as far as the grid reaches
void bound_slopes(const GridGeometry& grid, const Block<std::int16_t>& position, Block<float>& slopes);

/// The greatest of squares, 0 of none; and of those of a box of stretches with a box in it left out.
float greatest(std::span<const float> slopes);
float greatest_beside(std::span<const float> slopes, const Span3& all, const Span3& without);
/// The bound that a greatest square means, at least 1e-6.
double steepest_of(float square);

}  // namespace palpate::internal
