#pragma once

#include <cstdint>

#include "surfaces/surface_block.h"

namespace palpate::internal {

/// Number of voxels along each axis within a reach.
Index3 distance_window(const Eigen::Vector3d& spacing_mm, double reach_mm);

/// Exact Euclidean distance, mm, from each voxel centre to the nearest voxel centre of the other class:
/// positive where the mask is 0, negative where it is 1, clamped to `reach_mm`. Supports anisotropic voxels.
/// Never 0, so that its sign equals the mask.
///
/// Distances to centres rather than faces of voxels: of the definitions tried, this one depends least on the
/// orientation of the surface (docs/decisions/archive/0009-surfaces-from-labels.md). For a plane in random
/// position its zero level is the plane; some voxels away it is up to half a voxel too large if the surface
/// is parallel to a plane of voxels, and correct otherwise.
///
/// Separable: the minimum of squared distances along k, found by counting, then j, then i, each over the
/// voxels within reach. For a reach of some ten voxels this is faster with SIMD than lower envelopes of
/// parabolas (Felzenszwalb and Huttenlocher, Distance transforms of sampled functions, Theory of Computing 8,
/// 2012), with the same result.
/// @param mask  0 or 1; covers `distance` and distance_window() around it
void signed_distance(const Block<std::uint8_t>& mask, const Eigen::Vector3d& spacing_mm, double reach_mm,
                     Block<float>& distance);
/// One of the two passes of signed_distance(): writes, at every voxel whose mask differs from `other`, the
/// signed distance to the nearest voxel centre whose mask equals `other`; the other values are unchanged.
void distance_to_class(const Block<std::uint8_t>& mask, std::uint8_t other, const Eigen::Vector3d& spacing_mm,
                       double reach_mm, Block<float>& distance);

}  // namespace palpate::internal
