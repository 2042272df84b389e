#pragma once

#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/dicom/dicom_segments.h"

/// Grid of a DICOM segmentation's frames. Plain data, as dicom_volumes.h.
namespace palpate::volume_io {

/// Grid of a segmentation's frames. Files omit empty frames, so the grid is inferred from the positions of
/// the others.
struct SegmentGrid {
  GridGeometry geometry;  ///< Sheared if the gantry was tilted.
  std::vector<int> slice_of_frame;
  std::vector<std::string> notes;  ///< Contradictions in the file, and how they were resolved.
};
/// Computes the grid. Errors, without `where`: no frame; frames of several orientations, offset sideways,
/// between slices, duplicated for one segment and position, or of an undescribed segment.
Result<SegmentGrid> segment_grid_of(const DicomSegmentation& segmentation);

}  // namespace palpate::volume_io
