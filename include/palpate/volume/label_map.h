#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "palpate/volume/volume.h"

/// Segmentations, and statistics of their structures.
namespace palpate {

/// One structure of a segmentation.
struct Segment {
  LabelId id = 0;    ///< Unique in its LabelMap; equals `value` unless layers reuse values.
  std::string name;  ///< Empty if no file names the segment.
  Rgb colour;
  int layer = 0;      ///< Index of the LabelMap's layer that contains it.
  LabelId value = 0;  ///< Voxel value of the segment in that layer.
};

/// Segmentation. Usually one layer; overlapping segments (Slicer's .seg.nrrd) need several, all on one grid.
/// Within a layer each voxel belongs to at most one segment.
struct LabelMap {
  std::vector<Volume<LabelId>> layers;  ///< At least one.
  std::vector<Segment> segments;        ///< Ascending id; contains every non-zero (layer, value) present in
                                        ///< the voxels.

  const GridGeometry& geometry() const { return layers.front().geometry(); }
  const Segment* find(LabelId id) const;
  const Segment* find(const std::string& name) const;  ///< Finds a segment by its exact name.
  /// Single volume of segment ids; where layers overlap, the one with the highest index wins.
  Volume<LabelId> flattened() const;
};

/// Size, extent and connectivity of one segment.
struct SegmentStatistics {
  LabelId id = 0;
  std::size_t voxels = 0;
  double volume_mm3 = 0;
  std::array<int, 3> box_min{0, 0, 0}, box_max{0, 0, 0};  ///< Bounding box; inclusive voxel indices.
  Point<Patient> centroid;                                ///< Mean of the voxel centres.
  int components = 0;                                     ///< Number of connected components; voxels are
                                                          ///< connected if they share a face.
  std::size_t largest_component_voxels = 0;
};

/// Statistics of each segment with at least one voxel, in order of ascending id.
std::vector<SegmentStatistics> segment_statistics(const LabelMap& labels);

/// Slices along k that contain no non-zero voxel in any layer.
std::vector<int> empty_slices(const LabelMap& labels);

}  // namespace palpate
