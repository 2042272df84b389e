#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

/// DICOM files written by DCMTK, for tests of readers. Free of DCMTK's types, because its headers take long
/// to compile.
namespace palpate::test {

/// Encoding of the pixels.
enum class DicomPacking {
  kImplicit,
  kExplicit,
  kBigEndian,
  kDeflated,
  kRle,
  kJpegBaseline,  ///< 8 bits, lossy.
  kJpegExtended,  ///< 12 bits, lossy.
  kJpegLossless,
  kJpegLosslessFirstOrder,
  kJpegLs,
  kJpegLsNear,  ///< Lossy, with an error of at most 2.
  kJpeg2000Lossless,
  kJpeg2000,       ///< Lossless, in a syntax that also allows lossy compression.
  kJpeg2000Lossy,  ///< Lossy.
};
/// Text of an attribute without a member below.
struct DicomText {
  std::uint16_t group = 0, element = 0;
  std::string text;
};

/// An image, or the frames of a multi-frame image. Empty members are not written.
struct DicomImage {
  std::string series = "1.2.826.0.1.3680043.2.1143.1";
  std::string modality = "CT", image_type = "ORIGINAL\\PRIMARY\\AXIAL", photometric = "MONOCHROME2";
  std::string patient;  ///< Written to PatientName, descriptions, attributes near dates and a private tag.
  int rows = 6, columns = 8;
  std::array<double, 6> orientation{1, 0, 0, 0, 1, 0};
  std::optional<std::array<double, 2>> spacing_mm = std::array<double, 2>{0.7, 0.5};  ///< Distance between
                                                                                      ///< rows and between
                                                                                      ///< columns.
  int bits_allocated = 16, bits_stored = 16, high_bit = 15, samples = 1;
  bool is_signed = false;
  std::optional<int> packed_bits;  ///< For JPEG 2000, if they differ from those stored.
  std::optional<bool> packed_sign;
  std::size_t pieces = 1;  ///< Fragments per frame, for JPEG 2000.
  std::optional<double> echo_time_ms, b_value, trigger_time_ms;
  std::optional<std::array<double, 3>> gradient;
  std::optional<int> padding, instance_number, acquisition;
  std::string sop_instance;  ///< Empty: a new one.

  struct Frame {
    std::array<double, 3> position{0, 0, 0};
    std::vector<std::uint16_t> stored;  ///< Stored words, rows x columns.
    std::optional<double> slope, intercept, trigger_time_ms;
    std::optional<std::uint32_t> temporal_position;  ///< TemporalPositionIndex, UL; for a multi-frame image.
  };
  std::vector<Frame> frames{1};
  bool multi_frame = false;  ///< Enhanced image with functional groups.
  std::vector<DicomText> texts;
};

/// A segmentation. Empty members are not written.
struct DicomMasks {
  struct Segment {
    int number = 1;
    std::string label = {}, code = {}, scheme = "SCT", meaning = {},
                side = {};  ///< Side: a code of the same scheme.
  };
  struct Frame {
    int segment = 1;
    std::array<double, 3> position{0, 0, 0};
    std::vector<std::uint16_t> values;  ///< rows x columns
  };
  std::string type = "BINARY";
  int bits = 1;  ///< Bits allocated: 1, 8 or 16.
  int rows = 5, columns = 7;
  std::array<double, 6> orientation{1, 0, 0, 0, 1, 0};
  std::array<double, 2> spacing_mm{0.7, 0.5};
  std::optional<double> slice_spacing_mm = 1.25;
  std::optional<int> most = {}, padding = {};
  std::vector<Segment> segments{1};
  std::vector<Frame> frames = {};
  std::string frame_of_reference = {}, series = {};  ///< Reference to the images on which it was made.
  std::vector<std::string> images = {};              ///< Their SOPInstanceUIDs.
  std::string character_set = {};
  std::vector<std::array<std::uint8_t, 3>> palette = {};  ///< For labels, from 0 on: PALETTE COLOR.
  std::string own_series = "1.2.3", concatenation = {};
};
void write_masks(const std::filesystem::path& file, const DicomMasks& masks,
                 DicomPacking packing = DicomPacking::kExplicit);

/// A structure set. Empty members are not written.
struct DicomContours {
  struct Contour {
    std::vector<std::array<double, 3>> points;
    std::string type = "CLOSED_PLANAR";
    std::optional<int> declared_points = {};  ///< NumberOfContourPoints if it differs from the actual number.
    std::optional<std::string> data = {};     ///< ContourData if it differs from `points`.
  };
  struct Structure {
    std::string name = {}, code = {}, scheme = {}, meaning = {};
    std::vector<Contour> contours = {};
  };
  std::vector<Structure> structures;
  std::string frame_of_reference, series;  ///< Reference to the images on which it was drawn.
  std::string character_set = {};
  std::string patient;  ///< See DicomImage::patient.
};
void write_contours(const std::filesystem::path& file, const DicomContours& contours);

/// Terminates the program if DCMTK fails.
void write_dicom(const std::filesystem::path& file, const DicomImage& image,
                 DicomPacking packing = DicomPacking::kExplicit, bool preamble = true);

}  // namespace palpate::test
