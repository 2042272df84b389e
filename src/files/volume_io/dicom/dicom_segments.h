#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "volume_io/dicom/dicom_volumes.h"

/// Contents of a DICOM segmentation (SEG). Plain data, as dicom_volumes.h.
namespace palpate::volume_io {

struct DicomSegment {
  int number = 0;                                   ///< SegmentNumber.
  std::string label;                                ///< SegmentLabel; any text.
  std::string code, scheme, meaning;                ///< SegmentedPropertyType: "71341001", "SCT", "Femur".
  std::string side;                                 ///< "left", "right" or empty, from modifier codes.
  std::optional<std::array<std::uint16_t, 3>> lab;  ///< RecommendedDisplayCIELabValue.
  std::optional<std::array<std::uint8_t, 3>> rgb;   ///< Colour from the file's palette, if `lab` is missing.
  bool operator==(const DicomSegment&) const = default;
};

/// Encoding of segments in the values of one file's frames.
struct SegmentCoding {
  enum class Kind {
    kBinary,      ///< One bit per voxel of one segment.
    kFractional,  ///< A voxel belongs to the segment if its value is at least half of `max_fractional_value`.
    kLabels,      ///< The voxel's segment number.
  };
  Kind kind = Kind::kBinary;
  std::int64_t max_fractional_value = 255;  ///< MaximumFractionalValue.
  /// For kLabels, the value of voxels in no segment, in addition to 0.
  std::optional<std::int64_t> background_value;
  int number_offset = 0;  ///< For kLabels, added to a value to obtain the segment number.
};

struct DicomSegmentation {
  std::vector<SegmentCoding> codings;         ///< Indexed by DicomFrame::file.
  std::string series_uid, concatenation_uid;  ///< Compared, never displayed.
  std::optional<double> slice_spacing_mm;     ///< SpacingBetweenSlices, otherwise SliceThickness.
  std::vector<DicomSegment> segments;
  std::vector<DicomFrame> frames;
  std::vector<int> segment_of_frame;  ///< Segment number of each frame; 0 for kLabels.
};

/// Joins the files of one segmentation: concatenates their frames, with file indices in the given order.
/// Files of one concatenation share their segments. Segments of other files are renumbered if their numbers
/// would repeat.
/// @pre `files` is not empty
DicomSegmentation join_segmentations(std::vector<DicomSegmentation> files);

/// Assigns each segment the first layer in which it overlaps no other, in order.
/// @param overlaps  pairs of segment indices
std::vector<int> layers_of_segments(std::size_t segments, const std::vector<std::pair<int, int>>& overlaps);

}  // namespace palpate::volume_io
