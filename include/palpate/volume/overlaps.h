#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/volume/volume.h"

/// Segments of one LabelMap that share voxels.
namespace palpate {

/// Fraction of a segment's voxels that lie in another one from which on it counts as nested in that one:
/// contours of nested structures are drawn by hand and cross here and there.
inline constexpr double kNestedShare = 0.9;

/// Two segments that share voxels.
struct SegmentOverlap {
  LabelId smaller = 0, larger = 0;  ///< by number of voxels; where that is equal, by name and then by id
  std::size_t voxels = 0;           ///< shared
  double share = 0;                 ///< fraction of the smaller segment's voxels that are shared, 0 ... 1

  bool is_nested() const { return share >= kNestedShare; }
};

/// All pairs of segments that share a voxel, ordered by `smaller`, then by `larger`.
std::vector<SegmentOverlap> segment_overlaps(const LabelMap& labels);

/// By segment id, the segments in which each one is nested, smallest first; as long as the greatest id of a
/// nested segment demands. @param overlaps  segment_overlaps of one label map
std::vector<std::vector<LabelId>> enclosing_segments(std::span<const SegmentOverlap> overlaps);

/// One segment id for each voxel, independent of the order of layers and segments. Of the segments that share
/// a voxel those are left out that another one of them is nested in, unless the nested one has preference 0.
/// Of the others the one of highest preference gets the voxel; where that is equal, the smallest.
/// @param overlaps    segment_overlaps of `labels`
/// @param preference  by segment id, at least as long as the greatest id; 0: never before one above 0
Volume<LabelId> flatten(const LabelMap& labels, std::span<const SegmentOverlap> overlaps,
                        std::span<const std::uint16_t> preference);

}  // namespace palpate
