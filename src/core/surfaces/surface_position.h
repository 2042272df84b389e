#pragma once

#include <cstdint>

#include "surfaces/surface_filter.h"

namespace palpate::internal {

/// Filter of a surface's position from the distance of its mask.
///
///     smooth = distance * filter                         no staircase, spheres keep their size
///     wrong  = distance of a voxel's centre to the wrong side, relative to its own distance: 0 ... 1
///     keep   = maximum of `wrong` within 0.5 mm, smoothed over 0.25 mm
///     held   = smooth, but at least a quarter of the distance on the correct side
///     position = smooth + keep * (held - smooth), never farther out than the distance
///
/// Bones, whose voxels all or nearly all stay on their side, become smooth; where smoothing would remove
/// tissue or fill a gap, the labels prevail. No voxel changes sides: the sign at a voxel's centre equals its
/// label, so components are preserved and the surface moves by less than half a voxel.
struct PositionFilter {
  PositionFilter(const Eigen::Vector3d& spacing_mm, double sigma_mm);

  /// Distance around a voxel within which distances influence its position.
  Index3 reach() const;
  /// @param distance  mm; covers `position` and reach() around it
  void apply(const Block<float>& distance, Block<std::int16_t>& position) const;

  BlockKernel smooth, widen, soften;
};

}  // namespace palpate::internal
