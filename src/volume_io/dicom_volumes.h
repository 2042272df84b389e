#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/volume/volume.h"

/// Which images of DICOM files make a volume. Plain numbers, without the library that reads the files. What
/// comes out in words is made of numbers, of tags and of the standard's own terms: nothing of what a file
/// says in words, which may name a patient.
namespace palpate::volume_io {

/// One image: a file that holds one, or a frame of a multi-frame file.
struct DicomFrame {
  std::uint32_t file = 0, frame = 0;  ///< index of the file, and of the frame in it
  int series = 0;                     ///< index of its SeriesInstanceUID, in the order to be shown
  std::string modality;               ///< one of the standard's terms; empty for any other
  int rows = 0, columns = 0;
  bool placed = false;                                        ///< the four below are known
  Eigen::Vector3d position{0, 0, 0};                          ///< centre of the first voxel, LPS mm
  Eigen::Vector3d along_row{1, 0, 0}, along_column{0, 1, 0};  ///< unit; ImageOrientationPatient
  double row_spacing_mm = 1, column_spacing_mm = 1;  ///< between rows and columns: PixelSpacing, in its order
  /// What tells volumes of one series apart.
  std::optional<double> echo_time_ms, b_value, temporal_position;
  std::optional<std::array<double, 3>> gradient;  ///< direction of diffusion, DiffusionGradientOrientation
  std::string stack, image_type, frame_of_reference;  ///< compared and never shown as they are
  /// What does so where images lie at one place, and else may differ from slice to slice.
  std::optional<double> trigger_time_ms;
  std::optional<int> acquisition;
  std::optional<double>
      slice_spacing_mm;             ///< SpacingBetweenSlices; positions decide where it contradicts them
  double slope = 1, intercept = 0;  ///< value = slope * stored + intercept
  int bits_allocated = 16, bits_stored = 16, high_bit = 15;
  bool is_signed = false;
  bool lossy = false;  ///< compressed so that its values are not those that were measured
  std::optional<std::int64_t> padding, padding_limit;  ///< words that are no image, both included
  /// What makes this image unusable by itself, and what helps: "is compressed as MPEG-4, which is not read"
  std::string fault, remedy;

  bool operator==(const DicomFrame&) const = default;
};

struct DicomVolume {
  std::vector<DicomFrame> frames;  ///< by their place along the normal
  std::string what;                ///< "series 1: CT, axial, 512 x 512 x 90, 0.7 x 0.7 x 1.25 mm"
  std::string fault, remedy;       ///< empty: it can be used
  GridGeometry geometry;           ///< where it can be used; sheared where the gantry was tilted
  std::vector<std::string> notes;  ///< how contradictions between its files were resolved, a sentence each
};

/// All frames in volumes: by series and, within it, by rows and columns, orientation, pixel spacing, frame of
/// reference, echo time, b-value, direction of diffusion, temporal position, stack and image type; where that
/// leaves several at one place, by their trigger times in their order or by their acquisition's number.
/// Frames of reference that hold one place each, as some anonymising software leaves them, separate nothing.
/// In a volume the frames are ordered by the projection of their positions on the normal. A volume whose
/// slices are single, doubled, missing, uneven, turned or shifted irregularly against each other has a fault
/// that names the slice. A regular shift, by a tilted gantry, becomes a sheared grid.
std::vector<DicomVolume> sort_into_volumes(std::vector<DicomFrame> frames);

/// Whether some of its images are compressed with a loss.
bool is_lossy(const DicomVolume& volume);

/// How far the corner that is farthest from the position lies off where another image's orientation and
/// spacing would have it, mm.
double corner_off_mm(const DicomFrame& a, const DicomFrame& b);

/// "slice 7 of 90, at -12.50 mm along its normal", of a volume's frames in their order.
std::string slice_in_words(const std::vector<DicomFrame>& frames, std::size_t n);
/// The same of the grid that they became.
std::string slice_in_words(const GridGeometry& grid, std::size_t n);

/// Which of them is meant: the one of that number, from 1 on; without a number the only one that can be used.
/// Errors, without `where`: no such number, none or several that can be used, the fault of the one.
Result<std::size_t> choose_volume(const std::vector<DicomVolume>& volumes, std::optional<int> number);

}  // namespace palpate::volume_io
