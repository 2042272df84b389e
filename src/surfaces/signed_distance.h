#pragma once

#include <cstdint>

#include "surfaces/surface_block.h"

namespace palpate::internal {

/// The exact Euclidean distance, in mm, from each voxel centre to the nearest voxel centre of the other
/// class: positive where the mask is 0, negative where it is 1, at most `reach_mm` either way. Anisotropic
/// voxels. Never 0, so that its sign is the mask.
///
/// To centres, and not to the faces of voxels: of the definitions tried this one leans least with the
/// direction of the surface (docs/decisions/0009-surfaces-from-labels.md). Where a plane cuts the grid at
/// random its zero is the plane; what it says some voxels away is up to half a voxel too far where the
/// surface is parallel to a plane of voxels, and right elsewhere.
///
/// Separable: the least of squares along k, which counting tells, then j, then i, each over the voxels within
/// reach. For a reach of some ten voxels that is faster in vectors than lower envelopes of parabolas
/// (Felzenszwalb and Huttenlocher, Distance transforms of sampled functions, Theory of Computing 8, 2012),
/// with the same result.
/// @param mask      0 or 1; covers `distance` and distance_window() around it
Index3 distance_window(const Eigen::Vector3d& spacing_mm, double reach_mm);
void signed_distance(const Block<std::uint8_t>& mask, const Eigen::Vector3d& spacing_mm, double reach_mm,
                     Block<float>& distance);
/// One half of it: where the mask is not `other`, the signed distance to the nearest centre where it is;
/// elsewhere `distance` stays as it was.
void distance_to_class(const Block<std::uint8_t>& mask, std::uint8_t other, const Eigen::Vector3d& spacing_mm,
                       double reach_mm, Block<float>& distance);

}  // namespace palpate::internal
