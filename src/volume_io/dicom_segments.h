#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/dicom_volumes.h"

/// What a DICOM segmentation (SEG) says, and the grid that its frames lie on. Plain numbers, as
/// dicom_volumes.h.
namespace palpate::volume_io {

struct DicomSegment {
  int number = 0;                     ///< SegmentNumber
  std::string label;                  ///< SegmentLabel, may be any text
  std::string code, scheme, meaning;  ///< of its SegmentedPropertyType: "71341001", "SCT", "Femur"
  std::string side;                   ///< "left", "right", "bilateral" or empty, from modifier codes
  std::optional<std::array<std::uint16_t, 3>> lab;  ///< RecommendedDisplayCIELabValue
  std::optional<std::array<std::uint8_t, 3>> rgb;   ///< from the file's palette, where lab is missing
  bool operator==(const DicomSegment&) const = default;
};

/// How the values of one file's frames mean segments.
struct SegmentCoding {
  enum class Kind {
    kBinary,      ///< a bit for each voxel of one segment
    kFractional,  ///< a voxel is in where its value is half of `most` or more
    kLabels,      ///< a segment's number for each voxel
  };
  Kind kind = Kind::kBinary;
  std::int64_t most = 255;              ///< MaximumFractionalValue
  std::optional<std::int64_t> nothing;  ///< of kLabels the value of what is in no segment, besides 0
  int number_offset = 0;                ///< of kLabels, added to a value to get the segment's number
};

struct DicomSegmentation {
  std::vector<SegmentCoding> codings;         ///< by DicomFrame::file
  std::string series_uid, concatenation_uid;  ///< compared and never shown
  std::optional<double> slice_spacing_mm;     ///< SpacingBetweenSlices, else SliceThickness
  std::vector<DicomSegment> segments;
  std::vector<DicomFrame> frames;
  std::vector<int> segment_of_frame;  ///< its number; 0 of kLabels
};

/// One segmentation of several files, with the frames of all and indices of files in their order. Files of
/// one concatenation share their segments. Those of other files are numbered on where numbers would repeat.
/// @pre not empty
DicomSegmentation join_segmentations(std::vector<DicomSegmentation> files);

/// Where its frames lie. Those that hold nothing are left out of a file, wherever they are.
struct SegmentGrid {
  GridGeometry geometry;  ///< sheared where the gantry was tilted
  std::vector<int> slice_of_frame;
  std::vector<std::string> notes;  ///< what the file says otherwise, and what was taken
};
/// Errors, without `where`: no frame, frames of several orientations, beside each other, between slices, of
/// one segment at one place twice, of a segment that is not described.
Result<SegmentGrid> lay_segments(const DicomSegmentation& segmentation);

/// What a segment is called: its label, or its type where that is known and the label does not say it; with
/// its side.
std::string name_of_segment(const DicomSegment& segment);
/// What is known of a segment by its name alone: code, scheme and meaning where its type has one of SNOMED
/// CT, and its side.
DicomSegment segment_called(const std::string& name);
/// "0.87 0.68 0.51", as Slicer's fields have it, of CIELab by D65, as DICOM PS3.3 C.10.7.1.1 has it, or of
/// the palette; empty where it has neither.
std::string colour_of_segment(const DicomSegment& segment);
/// Whether it is what is in no segment (code 125040 of DCM).
bool is_background(const DicomSegment& segment);

/// For each segment the layer in which it meets no other: the first such, in their order.
/// @param overlaps  pairs of indices of segments
std::vector<int> layers_of_segments(std::size_t segments, const std::vector<std::pair<int, int>>& overlaps);

}  // namespace palpate::volume_io
