#pragma once

#include <cstdint>

#include "surfaces/surface_filter.h"

namespace palpate::internal {

/// The grid of a normal: every n-th voxel of the position's along each axis, about kNormalGrid_mm apart.
inline constexpr double kNormalGrid_mm = 0.6;
struct NormalGrid {
  explicit NormalGrid(const GridGeometry& fine);

  /// The grid's points in a box of the fine grid.
  Span3 inside(const Span3& fine) const;

  Index3 step;
  GridGeometry geometry;
};

/// The broad distance: a Gaussian over the distance cut off at kBroadReach_mm, which keeps what lies behind
/// thin tissue, and other sides of a bone, from weighing more than the surface itself.
inline constexpr double kBroadReach_mm = 2;
struct BroadFilter {
  BroadFilter(const Eigen::Vector3d& spacing_mm, double sigma_mm)
      : kernel(gaussian_block_kernel(spacing_mm, sigma_mm)) {}
  Index3 reach() const { return kernel.reach(); }
  /// @param distance  mm, at most kBroadReach_mm; covers `broad` and reach() around it
  void apply(const Block<float>& distance, Block<std::int16_t>& broad) const;

  BlockKernel kernel;
};

/// The field whose gradient is the normal.
///
///     height = mean over the surface nearby of the broad distance
///     normal = (1 - share) * broad + share * bent position + what makes the surface level,
///     share  = share(height)
///
/// On a bone the broad distance is 0 at the surface but for its curvature, the height is small, and the
/// normal is the broad distance's. Where tissue is thin, or has an edge sharper than the Gaussian, the height
/// is large and the broad gradient goes astray; there the position's takes over. Both grow alike on the way
/// out (the position is bent to grow as the broad distance over a plane does), and of the surface itself they
/// make the same level, so that the share may vary from place to place without turning the gradient.
struct NormalFilter {
  /// @param sigma_mm  of the broad distance
  NormalFilter(const Eigen::Vector3d& spacing_mm, double sigma_mm);
  Index3 reach() const { return kernel.reach(); }
  /// @param broad, position  mm, at the normal's grid; cover `normal` and reach() around it
  void apply(const Block<float>& broad, const Block<float>& position, Block<std::int16_t>& normal) const;

  BlockKernel kernel;
  float slope;  ///< of the broad distance at a plane
};

}  // namespace palpate::internal
