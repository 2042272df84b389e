#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/contact/model.h"
#include "palpate/volume/bricks.h"

/// Pictures of a model: oblique sections, and the force field of a method over a section.
namespace palpate {

/// 8-bit RGB image, row 0 at the top.
struct Image {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;  ///< 3 * width * height
};

/// Plane in the patient frame with a window of pixels on it.
struct SectionPlane {
  Point<Patient> centre;  ///< Centre of the picture
  Vector<Patient> right;  ///< Unit vector to the picture's right
  Vector<Patient> down;   ///< Unit vector to the picture's bottom, orthogonal to `right`
  double width_mm = 100;
  int width_px = 512, height_px = 512;

  double mm_per_px() const { return width_mm / width_px; }
  /// Precondition: both dimensions are positive.
  std::size_t pixel_count() const;
  Point<Patient> at(double column, double row) const;             ///< Position of a pixel (centre 0,0)
  std::array<double, 2> pixel_of(const Point<Patient>& p) const;  ///< Orthogonal projection onto the plane
};

enum class AnatomicalPlane { kAxial, kSagittal, kCoronal };
/// Section through `centre` in radiological convention: patient's left on picture right in axial and coronal,
/// anterior on picture left in sagittal.
SectionPlane anatomical_section(AnatomicalPlane plane, const Point<Patient>& centre, double width_mm,
                                int width_px, int height_px);

/// Orientation of an oblique section relative to a direction.
enum class ObliqueView {
  kAlong,   ///< The section contains the direction, which points down the picture: depth grows downwards
  kAcross,  ///< The direction is the section's normal, pointing away from the viewer
};
/// Section along or across a direction, such as that of a tool (into the tissue) or of a push (against the
/// contact force). Its in-plane orientation is that of the coronal section rotated by the smallest rotation
/// that takes the coronal section's own direction (inferior along, posterior across) to the given one: right
/// and down follow the direction without spinning, across superior is the axial section and across the
/// patient's right the sagittal one. At the opposite direction (superior along, anterior across) the smallest
/// rotation is not unique; there the picture is rotated about the patient's left-right axis, and nearby
/// directions differ greatly in orientation.
/// @param direction  any length; zero or not finite: the coronal section's own direction
/// @param before     previous section of a sequence, from which the rotation starts instead; no direction is
///                   then singular for a smooth motion
SectionPlane oblique_section(const Point<Patient>& centre, const Vector<Patient>& direction, ObliqueView view,
                             double width_mm, int width_px, int height_px,
                             const SectionPlane* before = nullptr);

/// Anatomical letters of the directions to which the picture's left, right, top and bottom edges point, e.g.
/// "L", or "LA" if oblique by more than 20 degrees.
struct OrientationLetters {
  std::string left, right, top, bottom;
};
OrientationLetters orientation_letters(const SectionPlane& plane);

/// Displacement of the tissue that is at a point at rest; patient frame, mm. Continuous, and with a gradient
/// below 1, so that tissue does not fold; called for many points of a picture, on the rendering thread.
using TissueDisplacement = std::function<Vector<Patient>(const Point<Patient>& at_rest)>;
/// Rest position of the tissue that is displaced to `displayed`: solves x + moved(x) = displayed by
/// fixed-point iteration x <- displayed - moved(x), with half steps if full steps do not converge, to
/// kAtRestNear_mm; the last of kMaxAtRestSteps iterates where tissue folds.
Point<Patient> rest_position(const Point<Patient>& displayed, const TissueDisplacement& moved);
inline constexpr double kAtRestNear_mm = 0.002;
inline constexpr int kMaxAtRestSteps = 16;
/// Label map deformed by a displacement field: each voxel gets the label of the voxel nearest to its rest
/// position, or background if that is outside the grid.
/// @param within  voxels of the grid to which displacements are confined
/// @returns new labels for the smallest box of 8 x 8 x 8 blocks in which anything moves by a tenth of a
///          voxel; size 0 if nothing does
PatchOf<LabelId> moved_labels(const Bricks<LabelId>& labels, const TissueDisplacement& moved,
                              const VoxelBox& within);

/// Appearance of sections.
struct SectionStyle {
  double window_low = 0, window_high = 0;  ///< Display window of the scan; equal: scan_window()
  /// Opacity of the colour over the scan, 0 ... 1; multiplied by the tissue's own
  double label_opacity = 0.55;
  bool outlines = true;   ///< Draw structures' outlines in full colour
  int grey_levels = 256;  ///< 2 ... 256; fewer levels give a smaller PNG
  /// Displacement of tissue: each pixel shows the rest position that rest_position returns. None: no
  /// displacement.
  TissueDisplacement moved = {};
};

/// 1st and 99th percentile of a scan's finite values, from at most about a million samples uniformly
/// distributed over the volume; {0, 1} if they are equal.
std::array<double, 2> scan_window(const Volume<float>& scan);

/// 8-bit RGBA image, row 0 at the top, colours not premultiplied by alpha.
struct Overlay {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  ///< 4 * width * height
};

namespace internal::section {
class Volumes;
class Pixels;
class RowCursor;
}  // namespace internal::section

/// Memory layout of the voxels that a SectionRenderer reads.
enum class SectionStorage {
  kModel,  ///< Scan in the model, labels in a copy of 2 bytes per voxel: for single pictures
  /// Copies in bricks of 8x8x8 voxels, which keep the voxels of any plane close together in memory: several
  /// times as fast, for pictures that follow a tip. 3 bytes per voxel for the scan, 1.5 for up to 256 labels,
  /// 3 for more. Scan values are quantised to 16 bits: exactly if all are integers within a range of 65 534,
  /// otherwise to 1/131 068 of their range, where values more than 16 automatic windows away from the
  /// automatic window are clamped. Volumes longer than 8192 voxels or with more than 1.4e9 voxels are read
  /// from the model.
  kBricks,
};

/// Renders sections of one model in sequence: scan (grey, trilinear), with labels (nearest neighbour,
/// structure colours) over it. Without a scan, outside it, and where one of the eight voxels is not finite,
/// the background is dark and neutral. Interpolation extrapolates the outermost half voxels by their border
/// values. Allocates memory only if a picture is larger than all before. Shares ownership of the model's
/// volumes, which have less than 2^31 voxels, not of the model. Not thread-safe; a copy may render on another
/// thread and shares the prepared data. Bit-identical on every SIMD target.
class SectionRenderer {
 public:
  explicit SectionRenderer(const Model& model, const SectionStyle& style = {},
                           SectionStorage storage = SectionStorage::kBricks);
  SectionRenderer(const SectionRenderer& other);
  SectionRenderer(SectionRenderer&& other) noexcept;
  SectionRenderer& operator=(const SectionRenderer& other);
  SectionRenderer& operator=(SectionRenderer&& other) noexcept;
  ~SectionRenderer();

  void set_style(const SectionStyle& style);
  const SectionStyle& style() const { return style_; }
  /// Size of the bricks in bytes; 0 without bricks.
  std::size_t prepared_bytes() const;

  /// Renders the scan layer with the structure layer over it.
  /// @param rgb  3 * width_px * height_px
  void render(const SectionPlane& plane, std::span<std::uint8_t> rgb);
  /// Render the two layers separately, for pages that blend them.
  /// @param rgba  4 * width_px * height_px
  void render_scan(const SectionPlane& plane, std::span<std::uint8_t> rgb);
  void render_structures(const SectionPlane& plane, std::span<std::uint8_t> rgba);
  /// Structure in each pixel, row by row; 0 for none and outside the volume.
  void labels(const SectionPlane& plane, std::span<LabelId> labels);

 private:
  struct Colouring {
    Rgb colour;
    double opacity = 1;
  };
  enum class Layers { kScan, kLabels, kBoth };
  /// Samples greys and labels of the requested layers.
  internal::section::RowCursor sample(const SectionPlane& plane, Layers layers);

  SectionStyle style_;
  std::shared_ptr<const internal::section::Volumes> volumes_;
  std::unique_ptr<internal::section::Pixels> pixels_;
  std::vector<Colouring> colours_;                   ///< By label, as far as the model defines them
  std::vector<std::array<std::uint8_t, 4>> paints_;  ///< For every label: inside, outline
};

/// Single pictures, by a SectionRenderer with SectionStorage::kModel.
Image render_section(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});
Image render_scan_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});
Overlay render_structure_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});
std::vector<LabelId> section_labels(const Model& model, const SectionPlane& plane,
                                    const SectionStyle& style = {});

/// Section shown by a picture: an oblique one through a point, along or across a direction; an anatomical
/// one; or axial, coronal and sagittal side by side.
enum class SectionKind { kAxial, kSagittal, kCoronal, kOblique, kThree };

/// Request for section_picture().
struct SectionRequest {
  SectionKind kind = SectionKind::kAxial;
  Point<Patient> centre;      ///< Centre of the picture, marked by a cross
  Vector<Patient> direction;  ///< Direction of an oblique section, any length
  ObliqueView view = ObliqueView::kAlong;
  double size_mm = 0;  ///< Width and height; 0: the longest side of the volume
  /// Width and height, of each of three sections; kMinSectionPixels ... kMaxSectionPixels
  int pixels = 768;
  SectionStyle style;
};
inline constexpr int kMinSectionPixels = 320, kMaxSectionPixels = 4096;

/// Annotated section for standalone use: orientation letters at the edges, the side of the patient or that it
/// is unknown, plane, position and window, a scale bar, names of the visible structures, and the note that it
/// is for research and education. No title and no path.
/// Errors: kBadInput with "centre" as the place for a centre outside the volume.
Result<Image> section_picture(const Model& model, const SectionRequest& request);

/// Encodes as lossless PNG without text or time chunks: greyscale if possible, with a palette if at most 256
/// colours occur, otherwise 8-bit RGB or RGBA. Precondition: the image is not empty.
std::vector<std::uint8_t> encode_png(const Image& image);
std::vector<std::uint8_t> encode_png(const Overlay& overlay);
/// Writes the image as PNG, atomically.
Result<void> write_png(const std::filesystem::path& file, const Image& image);

/// Region in which a force method is sampled: a square section along the patient's axes.
struct ForceArrowsRequest {
  AnatomicalPlane plane = AnatomicalPlane::kAxial;
  Point<Patient> centre;
  double size_mm = 20;
  double spacing_mm = 0;  ///< Distance between arrows; 0: size_mm / kArrowsPerSide
};
inline constexpr int kArrowsPerSide = 24, kMaxArrowsPerSide = 200;

/// Forces of one method on a grid in a section, as a self-contained SVG: arrows over the scan and the
/// structures, contour lines of the field, scales for forces and lengths, orientation letters, and a caption.
/// Contains structures' names, but no title and no path.
/// @param method  the model has to be prepared for it (Model::has)
/// Errors: kBadInput with "centre" or "spacing" as the place for a centre outside the volume and for more
/// than kMaxArrowsPerSide arrows per side; kInterrupted.
Result<std::string> force_arrows_svg(const Model& model, ForceMethod method,
                                     const ForceArrowsRequest& request, const Progress& progress = {});
/// Writes the SVG of force_arrows_svg(), atomically.
Result<void> write_force_arrows(const std::filesystem::path& file, const Model& model, ForceMethod method,
                                const ForceArrowsRequest& request, const Progress& progress = {});

}  // namespace palpate
