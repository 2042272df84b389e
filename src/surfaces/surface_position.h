#pragma once

#include <cstdint>

#include "surfaces/surface_filter.h"

namespace palpate::internal {

/// The position of a surface from the distance of its mask.
///
///     smooth = distance * filter                         no staircase, spheres keep their size
///     wrong  = how far a voxel's centre came to lie on the wrong side, of its distance: 0 ... 1
///     keep   = the greatest `wrong` within 0.5 mm, smoothed over 0.25 mm
///     held   = smooth, but on its side by a quarter of the distance at least
///     position = smooth + keep * (held - smooth), never farther out than the distance itself
///
/// So bones, whose voxels all stay on their side or nearly so, are smooth, and where smoothing would eat
/// tissue (or fill a gap) the labels decide. No voxel changes sides: the sign at a voxel's centre is its
/// label, which makes components survive as they are, and the surface moves by less than half a voxel.
struct PositionFilter {
  PositionFilter(const Eigen::Vector3d& spacing_mm, double sigma_mm);

  /// How far around a voxel the distances matter for its position.
  Index3 reach() const;
  /// @param distance  mm; covers `position` and reach() around it
  void apply(const Block<float>& distance, Block<std::int16_t>& position) const;

  BlockKernel smooth, widen, soften;
};

}  // namespace palpate::internal
