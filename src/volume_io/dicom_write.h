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

/// Writes objects of DICOM, by DCMTK, in libpalpate_dicom.so. Plain numbers, as dicom_volumes.h.
namespace palpate::volume_io {

/// Which patient and study an object belongs to, as an image of it says; texts in its character set.
struct DicomIdentity {
  /// Attributes of the modules Patient and General Study, by group and element, as text.
  std::vector<std::pair<std::pair<std::uint16_t, std::uint16_t>, std::string>> attributes;
  std::string frame_of_reference, series;
  std::vector<std::pair<std::string, std::string>> images;  ///< SOPClassUID and SOPInstanceUID
};
/// Of one file; its image is the only one of `images`. Errors, without `where`: no DICOM file.
Result<DicomIdentity> read_dicom_identity(const std::filesystem::path& name);

struct SegmentToWrite {
  std::string name;
  std::array<std::uint8_t, 3> colour{};
  std::string code, meaning;  ///< of SNOMED CT; empty: a tissue
  std::string side;           ///< "left", "right" or empty
};

struct SegFrameToWrite {
  int segment = 1;  ///< its number, from 1 on
  Eigen::Vector3d position;
};

struct SegmentationToWrite {
  int rows = 0, columns = 0;
  Eigen::Vector3d along_row, along_column;  ///< unit
  double row_spacing_mm = 1, column_spacing_mm = 1, slice_spacing_mm = 1;
  std::vector<SegmentToWrite> segments;
  std::vector<SegFrameToWrite> frames;
  std::vector<std::uint8_t> bits;  ///< of all frames, the first is the lowest of its byte
};
/// Error kOutput.
Result<void> write_dicom_segments(const std::filesystem::path& file, const SegmentationToWrite& segmentation,
                                  const std::optional<DicomIdentity>& identity);

struct PictureToWrite {
  int rows = 0, columns = 0;
  std::span<const std::uint8_t> rgb;
  std::string description;
};
/// Error kOutput.
Result<void> write_dicom_picture(const std::filesystem::path& file, const PictureToWrite& picture,
                                 const std::optional<DicomIdentity>& identity);

}  // namespace palpate::volume_io
