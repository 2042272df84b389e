#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

/// DICOM files written by DCMTK, for tests of whoever reads them. No types of DCMTK here: its headers take
/// long.
namespace palpate::test {

/// How the voxels are packed.
enum class DicomPacking {
  kImplicit,
  kExplicit,
  kBigEndian,
  kDeflated,
  kRle,
  kJpegBaseline,  ///< of 8 bits, with a loss
  kJpegExtended,  ///< of 12 bits, with a loss
  kJpegLossless,
  kJpegLosslessFirstOrder,
  kJpegLs,
  kJpegLsNear,  ///< with a loss of 2 at most
  kJpeg2000Lossless,
  kJpeg2000,       ///< without a loss, though its syntax may have one
  kJpeg2000Lossy,  ///< with one
};
/// Text of an attribute that no member above has, in a data set that is written.
struct DicomText {
  std::uint16_t group = 0, element = 0;
  std::string text;
};

/// One image, or the frames of a multi-frame one. What is empty is not written.
struct DicomImage {
  std::string series = "1.2.826.0.1.3680043.2.1143.1";
  std::string modality = "CT", image_type = "ORIGINAL\\PRIMARY\\AXIAL", photometric = "MONOCHROME2";
  std::string patient;  ///< stands in PatientName, descriptions, dates' neighbours and a private tag
  int rows = 6, columns = 8;
  std::array<double, 6> orientation{1, 0, 0, 0, 1, 0};
  std::optional<std::array<double, 2>> spacing_mm = std::array<double, 2>{0.7, 0.5};  ///< of rows, of columns
  int bits_allocated = 16, bits_stored = 16, high_bit = 15, samples = 1;
  bool is_signed = false;
  std::optional<int> packed_bits;  ///< of JPEG 2000, where they are not those stored
  std::optional<bool> packed_sign;
  std::size_t pieces = 1;  ///< of JPEG 2000, a frame
  std::optional<double> echo_time_ms, b_value, trigger_time_ms;
  std::optional<std::array<double, 3>> gradient;
  std::optional<int> padding, instance_number, acquisition;
  std::string sop_instance;  ///< empty: one of its own

  struct Frame {
    std::array<double, 3> position{0, 0, 0};
    std::vector<std::uint16_t> stored;  ///< the words as they stand, rows x columns
    std::optional<double> slope, intercept, trigger_time_ms;
    std::optional<std::uint32_t> temporal_position;  ///< TemporalPositionIndex, UL; of a multi-frame image
  };
  std::vector<Frame> frames{1};
  bool multi_frame = false;  ///< as an enhanced image, with functional groups
  std::vector<DicomText> texts;
};

/// A segmentation. What is empty is not written.
struct DicomMasks {
  struct Segment {
    int number = 1;
    std::string label = {}, code = {}, scheme = "SCT", meaning = {},
                side = {};  ///< side: a code of the same scheme
  };
  struct Frame {
    int segment = 1;
    std::array<double, 3> position{0, 0, 0};
    std::vector<std::uint16_t> values;  ///< rows x columns
  };
  std::string type = "BINARY";
  int bits = 1;  ///< allocated: 1, 8 or 16
  int rows = 5, columns = 7;
  std::array<double, 6> orientation{1, 0, 0, 0, 1, 0};
  std::array<double, 2> spacing_mm{0.7, 0.5};
  std::optional<double> slice_spacing_mm = 1.25;
  std::optional<int> most = {}, padding = {};
  std::vector<Segment> segments{1};
  std::vector<Frame> frames = {};
  std::string frame_of_reference = {}, series = {};  ///< of the images that it was made on
  std::vector<std::string> images = {};              ///< their SOPInstanceUIDs
  std::string character_set = {};
  std::vector<std::array<std::uint8_t, 3>> palette = {};  ///< of labels, from 0 on: PALETTE COLOR
  std::string own_series = "1.2.3", concatenation = {};
};
void write_masks(const std::filesystem::path& file, const DicomMasks& masks,
                 DicomPacking packing = DicomPacking::kExplicit);

/// A structure set. What is empty is not written.
struct DicomContours {
  struct Contour {
    std::vector<std::array<double, 3>> points;
    std::string type = "CLOSED_PLANAR";
    std::optional<int> said_points = {};   ///< NumberOfContourPoints, where it is another number
    std::optional<std::string> data = {};  ///< ContourData, where it is not that of the points
  };
  struct Structure {
    std::string name = {}, code = {}, scheme = {}, meaning = {};
    std::vector<Contour> contours = {};
  };
  std::vector<Structure> structures;
  std::string frame_of_reference, series;  ///< of the images that it was drawn on
  std::string character_set = {};
  std::string patient;  ///< as of DicomImage
};
void write_contours(const std::filesystem::path& file, const DicomContours& contours);

/// Stops the program where DCMTK cannot.
void write_dicom(const std::filesystem::path& file, const DicomImage& image,
                 DicomPacking packing = DicomPacking::kExplicit, bool preamble = true);

}  // namespace palpate::test
