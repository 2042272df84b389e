#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"

/// Writes DICOM objects by DCMTK, in libpalpate_dicom.so. Plain data, as dicom_volumes.h.
namespace palpate::volume_io {

/// Patient and study to which an object belongs, as read from one of the study's images; text in UTF-8.
struct DicomIdentity {
  /// Attributes of the Patient and General Study modules: group and element, and value as text.
  std::vector<std::pair<std::pair<std::uint16_t, std::uint16_t>, std::string>> attributes;
  std::string frame_of_reference, series;
  std::vector<std::pair<std::string, std::string>> images;  ///< SOPClassUID and SOPInstanceUID.
};
/// Reads the identity from a file, whose own image is the only entry of `images`. Errors, without `where`:
/// not a DICOM file.
Result<DicomIdentity> read_dicom_identity(const std::filesystem::path& name);

struct SegmentToWrite {
  std::string name;
  std::array<std::uint8_t, 3> colour{};
  std::string code, meaning;  ///< SNOMED CT; empty: coded as tissue.
  std::string side;           ///< "left", "right" or empty.
};

struct SegFrameToWrite {
  int segment = 1;  ///< Segment number, from 1 on.
  Eigen::Vector3d position;
};

struct SegmentationToWrite {
  int rows = 0, columns = 0;
  Eigen::Vector3d along_row, along_column;  ///< Unit vectors.
  double row_spacing_mm = 1, column_spacing_mm = 1, slice_spacing_mm = 1;
  std::vector<SegmentToWrite> segments;
  std::vector<SegFrameToWrite> frames;
  std::vector<std::uint8_t> bits;  ///< One bit per voxel for all frames, least significant bit first.
};
/// Writes a segmentation. Errors: kOutput.
Result<void> write_dicom_segments(const std::filesystem::path& file, const SegmentationToWrite& segmentation,
                                  const std::optional<DicomIdentity>& identity);

struct PictureToWrite {
  int rows = 0, columns = 0;
  std::span<const std::uint8_t> rgb;
  std::string description;
};
/// Writes a Secondary Capture image. Errors: kOutput.
Result<void> write_dicom_picture(const std::filesystem::path& file, const PictureToWrite& picture,
                                 const std::optional<DicomIdentity>& identity);

}  // namespace palpate::volume_io
