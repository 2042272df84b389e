#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "palpate/geometry/geometry.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

namespace palpate {

/// Location of minimum thickness of a structure.
struct ThinSpot {
  double thickness_mm = 0;
  Point<Patient> position;
};
/// Minimum thickness of a structure, measured on its medial surface: voxels whose nearest outside voxels are
/// on opposite sides (at least 130 degrees apart). The thickness is the distance of these minus one voxel; a
/// plate of n voxels has thickness n. Rims taper off, so a medial voxel counts only if the medial surface
/// continues on all sides within kRim_mm. Protrusions of a thicker part by at most one voxel are ignored. The
/// boundary of the volume is not a side. Empty if there is no such voxel (a structure of a few voxels, or one
/// that fills the volume).
/// @param labels  flattened
std::optional<ThinSpot> minimum_thickness(const Volume<LabelId>& labels, const SegmentStatistics& structure);
/// Radius within which the medial surface has to continue on all sides.
inline constexpr double kRim_mm = 3;

/// Euclidean distance transform with feature indices: squared distance, mm2, of every voxel of a box to the
/// nearest voxel centre that is `outside`, and the index of that voxel (Felzenszwalb and Huttenlocher 2012,
/// separable). i varies fastest. -1: there is none.
struct NearestOutside {
  std::vector<float> squared_mm2;
  std::vector<std::int32_t> index;
};
NearestOutside nearest_outside(const std::array<int, 3>& dims, const Eigen::Vector3d& spacing_mm,
                               const std::vector<std::uint8_t>& outside);

}  // namespace palpate
