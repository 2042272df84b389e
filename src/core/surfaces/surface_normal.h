#pragma once

#include <cstdint>

#include "surfaces/surface_filter.h"

namespace palpate::internal {

/// Grid of a normal: every n-th voxel of the position's along each axis, about kNormalGrid_mm apart.
inline constexpr double kNormalGrid_mm = 0.6;
struct NormalGrid {
  explicit NormalGrid(const GridGeometry& fine);

  /// Points of this grid inside a box of the fine grid.
  Span3 inside(const Span3& fine) const;

  Index3 step;
  GridGeometry geometry;
};

/// Filter of the broad distance: a Gaussian over the distance clamped at kBroadReach_mm. The clamp prevents
/// regions behind thin tissue, and other sides of a bone, from outweighing the surface itself.
inline constexpr double kBroadReach_mm = 2;
struct BroadFilter {
  BroadFilter(const Eigen::Vector3d& spacing_mm, double sigma_mm)
      : kernel(gaussian_block_kernel(spacing_mm, sigma_mm)) {}
  Index3 reach() const { return kernel.reach(); }
  /// @param distance  mm, at most kBroadReach_mm; covers `broad` and reach() around it
  void apply(const Block<float>& distance, Block<std::int16_t>& broad) const;

  BlockKernel kernel;
};

/// Filter of the field whose gradient is the normal:
///
///     height = mean of the broad distance over the surface nearby
///     normal = (1 - share) * broad + share * bent position + a correction that levels the surface,
///     share  = share(height)
///
/// On a bone the broad distance at the surface is 0 except for curvature, so the height is small and the
/// normal is the broad distance's gradient. Where tissue is thin or has an edge sharper than the Gaussian,
/// the height is large and the broad gradient is misleading; there the position's gradient takes over. Both
/// have the same slope away from the surface (the position is bent to match the broad distance over a plane)
/// and the same level on it, so that a varying share does not change the gradient's direction.
struct NormalFilter {
  /// @param sigma_mm  width of the broad distance's Gaussian
  NormalFilter(const Eigen::Vector3d& spacing_mm, double sigma_mm);
  Index3 reach() const { return kernel.reach(); }
  /// @param broad,position  mm, on the normal's grid; cover `normal` and reach() around it
  void apply(const Block<float>& broad, const Block<float>& position, Block<std::int16_t>& normal) const;

  BlockKernel kernel;
  float slope;  ///< Slope of the broad distance at a plane
};

}  // namespace palpate::internal
