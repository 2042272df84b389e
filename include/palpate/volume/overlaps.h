#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// Segments of one LabelMap that share voxels.
namespace palpate {

/// Minimum fraction of a segment's voxels inside another one for which it counts as nested in that one:
/// contours of nested structures are drawn by hand and cross in places.
inline constexpr double kNestedFraction = 0.9;

/// Two segments that share voxels.
struct SegmentOverlap {
  LabelId smaller = 0, larger = 0;  ///< Ids in order of number of voxels; if equal, by name and then by id
  std::size_t voxels = 0;           ///< Number of shared voxels
  double fraction = 0;              ///< Shared fraction of the smaller segment's voxels, 0 ... 1

  bool is_nested() const { return fraction >= kNestedFraction; }
};

/// All pairs of segments that share a voxel, ordered by `smaller`, then by `larger`.
std::vector<SegmentOverlap> segment_overlaps(const LabelMap& labels);

/// Segments in which each segment is nested, smallest first; indexed by segment id, up to the greatest id of
/// a nested segment.
/// @param overlaps  segment_overlaps of one label map
std::vector<std::vector<LabelId>> enclosing_segments(std::span<const SegmentOverlap> overlaps);

/// Flattens the layers to one segment id per voxel, independent of the order of layers and segments. Among
/// the segments that share a voxel, those are excluded in which another one is nested, unless the nested one
/// has preference 0. Of the others the one with the highest preference gets the voxel; if equal, the
/// smallest.
/// @param overlaps    segment_overlaps of `labels`
/// @param preference  by segment id, at least up to the greatest id; 0: never precedes one above 0
Volume<LabelId> flatten(const LabelMap& labels, std::span<const SegmentOverlap> overlaps,
                        std::span<const std::uint16_t> preference);

}  // namespace palpate
