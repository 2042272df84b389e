#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/volume/volume.h"

/// Groups the images of DICOM files into volumes. Plain data, independent of the library that reads the
/// files. Texts are composed of numbers, tags and terms of the standard; they contain no text from the files,
/// which may name a patient.
namespace palpate::volume_io {

/// An image: a single-image file, or a frame of a multi-frame file.
struct DicomFrame {
  std::uint32_t file = 0, frame = 0;  ///< Index of the file, and of the frame in it.
  int series = 0;                     ///< Index of its SeriesInstanceUID, in display order.
  std::string modality;               ///< A term of the standard; empty for any other.
  int rows = 0, columns = 0;
  bool placed = false;                                        ///< The geometry below is known.
  Eigen::Vector3d position{0, 0, 0};                          ///< Centre of the first voxel, LPS mm.
  Eigen::Vector3d along_row{1, 0, 0}, along_column{0, 1, 0};  ///< Unit vectors; ImageOrientationPatient.
  double row_spacing_mm = 1, column_spacing_mm = 1;           ///< Distance between rows and between columns:
                                                              ///< PixelSpacing, in its order.
  /// Attributes that distinguish volumes of one series.
  std::optional<double> echo_time_ms, b_value, temporal_position;
  std::optional<std::array<double, 3>> gradient;      ///< Diffusion direction, DiffusionGradientOrientation.
  std::string stack, image_type, frame_of_reference;  ///< Compared, never displayed as they are.
  /// Attributes that distinguish volumes only if images share a position; otherwise they may vary from slice
  /// to slice.
  std::optional<double> trigger_time_ms;
  std::optional<int> acquisition;
  std::optional<double> slice_spacing_mm;  ///< SpacingBetweenSlices; positions take precedence if they
                                           ///< contradict it.
  double slope = 1, intercept = 0;         ///< value = slope * stored + intercept
  int bits_allocated = 16, bits_stored = 16, high_bit = 15;
  bool is_signed = false;
  bool lossy = false;  ///< Lossily compressed: values differ from those measured.
  std::optional<std::int64_t> padding, padding_limit;  ///< Stored values without image content, an inclusive
                                                       ///< range.
  /// Why this image is unusable by itself, and the remedy: "is compressed as MPEG-4, which is not read".
  std::string fault, remedy;

  bool operator==(const DicomFrame&) const = default;
};

struct DicomVolume {
  std::vector<DicomFrame> frames;  ///< Ordered by position along the normal.
  std::string what;                ///< Description: "series 1: CT, axial, 512 x 512 x 90, 0.7 x 0.7 x 1.25
                                   ///< mm".
  std::string fault, remedy;       ///< Empty if the volume can be used.
  GridGeometry geometry;           ///< Valid if the volume can be used; sheared if the gantry was tilted.
  std::vector<std::string> notes;  ///< Resolved contradictions between its files, one sentence each.
};

/// Groups frames into volumes: by series and, within it, by rows and columns, orientation, pixel spacing,
/// frame of reference, echo time, b-value, diffusion direction, temporal position, stack and image type; if
/// several frames still share a position, by the order of their trigger times or by acquisition number.
/// Frames of reference that each contain a single position, as left by some anonymisers, are ignored. Frames
/// of a volume are ordered by the projection of their positions on the normal. A volume whose slices are
/// single, duplicated, missing, unevenly spaced, rotated or irregularly shifted gets a fault that names the
/// slice. A regular shift, caused by a tilted gantry, yields a sheared grid.
std::vector<DicomVolume> sort_into_volumes(std::vector<DicomFrame> frames);

/// True if some of the volume's images are lossily compressed.
bool is_lossy(const DicomVolume& volume);

/// Unit normal of an image: along_row x along_column.
Eigen::Vector3d normal_of(const DicomFrame& frame);

/// Upper bound of the distance between the image corners farthest from the first voxel if one image had the
/// orientation and spacing of the other; mm.
double corner_off_mm(const DicomFrame& a, const DicomFrame& b);

/// Text "slice 7 of 90, at -12.50 mm along its normal", for a volume's ordered frames.
std::string slice_in_words(const std::vector<DicomFrame>& frames, std::size_t n);
/// The same text for a slice of the grid built from them.
std::string slice_in_words(const GridGeometry& grid, std::size_t n);

/// Selects a volume: the one of the given number, from 1 on; without a number the only one that can be used.
/// Errors, without `where`: no such number; none or several that can be used; the fault of the selected one.
Result<std::size_t> choose_volume(const std::vector<DicomVolume>& volumes, std::optional<int> number);

}  // namespace palpate::volume_io
