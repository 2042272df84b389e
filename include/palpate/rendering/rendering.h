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
#include "palpate/haptics/haptics.h"
#include "palpate/volume/bricks.h"

/// Pictures of a model: oblique sections, and a force method's arrows over one.
namespace palpate {

/// An 8-bit RGB picture, row 0 on top.
struct Image {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;  ///< 3 * width * height
};

/// A plane in the patient and the window on it.
struct SectionPlane {
  Point<Patient> centre;  ///< shown in the middle of the picture
  Vector<Patient> right;  ///< unit, to the picture's right
  Vector<Patient> down;   ///< unit, to the picture's bottom, orthogonal to `right`
  double width_mm = 100;
  int width_px = 512, height_px = 512;

  double mm_per_px() const { return width_mm / width_px; }
  /// A picture without pixels is a bug.
  std::size_t pixel_count() const;
  Point<Patient> at(double column, double row) const;             ///< pixel (centre 0,0) to patient
  std::array<double, 2> pixel_of(const Point<Patient>& p) const;  ///< projected onto the plane
};

enum class AnatomicalPlane { kAxial, kSagittal, kCoronal };
/// A radiological view through `centre`: patient's left on picture right in axial and coronal, anterior
/// on picture left in sagittal.
SectionPlane anatomical_section(AnatomicalPlane plane, const Point<Patient>& centre, double width_mm,
                                int width_px, int height_px);

/// How a direction lies to an oblique section.
enum class ObliqueView {
  kAlong,   ///< the section contains it, pointing down the picture: depth grows downwards
  kAcross,  ///< it is the section's normal, pointing away from the viewer: a look along it
};
/// A section along or across a direction, of a tool (into the tissue) or of a push (against the force felt).
/// It hangs as the coronal section does, turned with the direction by the least angle that turns the
/// coronal one's own (inferior along, posterior across) into it: right and down follow the direction without
/// spinning, across superior is the axial section and across the patient's right the sagittal one. Only at
/// the opposite direction (superior along, anterior across) no turn is the least; there the picture is turned
/// about the patient's left-right axis, and directions near it differ much in how they hang.
/// @param direction  any length; none (zero, not finite) is taken for the coronal section's own
/// @param before     the section that this one follows: turned from there instead, so that there is no place
///                   about which a direction that moves bit by bit spins
SectionPlane oblique_section(const Point<Patient>& centre, const Vector<Patient>& direction, ObliqueView view,
                             double width_mm, int width_px, int height_px,
                             const SectionPlane* before = nullptr);

/// Letters for the directions a view's edges point to, e.g. "L", or "LA" when oblique by more than 20
/// degrees: left, right, top, bottom of the picture.
struct OrientationLetters {
  std::string left, right, top, bottom;
};
OrientationLetters orientation_letters(const SectionPlane& plane);

/// How far the tissue that lies at a place at rest has gone from there, patient, mm. Continuous, and nowhere
/// so steep that tissue is folded; asked for many places of a picture, from the thread that draws.
using TissueMoved = std::function<Vector<Patient>(const Point<Patient>& at_rest)>;
/// Where the tissue lies at rest that is seen at a place: x with x + moved(x) = seen, by fixed-point steps
/// x <- seen - moved(x), half ones where whole ones do not settle, until it is as near as kAtRestNear_mm; the
/// last of kMostAtRestSteps where tissue is folded.
Point<Patient> place_at_rest(const Point<Patient>& seen, const TissueMoved& moved);
inline constexpr double kAtRestNear_mm = 0.002;
inline constexpr int kMostAtRestSteps = 16;
/// Labels as they are seen where tissue has gone: of each voxel the label of the voxel nearest to where it
/// lay at rest, background where that is outside the grid.
/// @param within  voxels of the grid; beyond them nothing moves
/// @returns new labels for the least box of 8 x 8 x 8 voxels' boxes in which something moves by a tenth of a
/// voxel; of size 0 where nothing does
PatchOf<LabelId> moved_labels(const Bricks<LabelId>& labels, const TissueMoved& moved,
                              const VoxelBox& within);

struct SectionStyle {
  double window_low = 0, window_high = 0;  ///< of the scan; equal: scan_window()
  double label_opacity = 0.55;             ///< of the colour over the scan, 0 ... 1, times the tissue's own
  bool outlines = true;                    ///< draw structures' borders at full colour
  int grey_levels = 256;                   ///< 2 ... 256; fewer make a smaller PNG
  /// Tissue is drawn where it has gone to: each pixel shows what lies at rest where place_at_rest says. None:
  /// at rest.
  TissueMoved moved = {};
};

/// The 1st and 99th percentile of a scan's finite values, from at most about a million of them evenly
/// spread over the volume; {0, 1} when there is no spread.
std::array<double, 2> scan_window(const Volume<float>& scan);

/// An 8-bit RGBA picture, row 0 on top, colours not multiplied by alpha.
struct Overlay {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  ///< 4 * width * height
};

namespace internal::section {
class Volumes;
class Pixels;
struct PixelView;
}  // namespace internal::section

/// Where a SectionRenderer reads voxels.
enum class SectionStorage {
  kModel,  ///< the scan in the model, labels in a copy of 2 bytes a voxel: for single pictures
  /// From copies in bricks of 8x8x8 voxels, in which the voxels of any plane lie close together: several
  /// times as fast, for pictures that follow a tip. 3 bytes a voxel for the scan, 1.5 for up to 256 labels, 3
  /// for more. A scan value is kept in 16 bits: exactly where all are whole numbers within 65 534 of each
  /// other; else to 1/131 068 of their range, in which values more than 16 automatic windows off the
  /// automatic one are cut there. Volumes longer than 8192 voxels or of more than 1.4e9 are read in the
  /// model.
  kBricks,
};

/// Draws sections of one model, one after another: scan (grey, linear) and labels (nearest neighbour,
/// structure colours) over it. Without a scan, and outside it, where eight voxels are not all finite too, a
/// dark neutral background. Linear interpolation needs no voxels beyond the volume: the outermost half voxels
/// repeat the border. Nothing is allocated for a picture unless it is larger than all before. Holds on to the
/// model's volumes, of less than 2^31 voxels, not to the model. For one thread at a time; a copy draws the
/// same on another and shares what was prepared. The same bits on every SIMD target.
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
  /// Of bricks; 0 without them.
  std::size_t prepared_bytes() const;

  /// The scan layer with the structure layer over it. @param rgb  3 * width_px * height_px
  void render(const SectionPlane& plane, std::span<std::uint8_t> rgb);
  /// The two layers, for pages that blend them themselves. @param rgba  4 * width_px * height_px
  void render_scan(const SectionPlane& plane, std::span<std::uint8_t> rgb);
  void render_structures(const SectionPlane& plane, std::span<std::uint8_t> rgba);
  /// The structure in each pixel, row by row; 0 for none and outside the volume.
  void labels(const SectionPlane& plane, std::span<LabelId> labels);

 private:
  struct Colouring {
    Rgb colour;
    double opacity = 1;
  };
  enum class Layers { kScan, kLabels, kBoth };
  /// Greys and labels of the layers asked for.
  internal::section::PixelView sample(const SectionPlane& plane, Layers layers);

  SectionStyle style_;
  std::shared_ptr<const internal::section::Volumes> volumes_;
  std::unique_ptr<internal::section::Pixels> pixels_;
  std::vector<Colouring> colours_;                   ///< by label, as far as the model says them
  std::vector<std::array<std::uint8_t, 4>> paints_;  ///< of every label: inside, outline
};

/// Single pictures, by a SectionRenderer that reads in the model.
Image render_section(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});
Image render_scan_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});
Overlay render_structure_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});
std::vector<LabelId> section_labels(const Model& model, const SectionPlane& plane,
                                    const SectionStyle& style = {});

/// Which section a picture shows: one of the patient's own, through a point and along or across a direction,
/// or axial, coronal and sagittal side by side.
enum class SectionKind { kAxial, kSagittal, kCoronal, kOblique, kThree };

struct SectionRequest {
  SectionKind kind = SectionKind::kAxial;
  Point<Patient> centre;      ///< in the middle of the picture, marked by a cross
  Vector<Patient> direction;  ///< of an oblique section, any length
  ObliqueView view = ObliqueView::kAlong;
  double size_mm = 0;  ///< width and height; 0: the volume's longest side
  int pixels = 768;    ///< width and height, of each of three; kLeastSectionPixels ... kMostSectionPixels
  SectionStyle style;
};
inline constexpr int kLeastSectionPixels = 320, kMostSectionPixels = 4096;

/// A section to look at on its own: orientation letters on the edges, the side of the patient or that nobody
/// knows it, plane, place and window, a scale bar, names of what is shown, and that it is for research and
/// education. No title and no path.
/// Errors: kBadInput for a centre outside the volume, with "centre" as the place.
Result<Image> section_picture(const Model& model, const SectionRequest& request);

/// Encodes as PNG without loss and without text or time chunks: grey when the picture is, a palette
/// when at most 256 colours occur, else 8-bit RGB or RGBA. An empty picture is a bug.
std::vector<std::uint8_t> encode_png(const Image& image);
std::vector<std::uint8_t> encode_png(const Overlay& overlay);
/// Writes whole or not at all.
Result<void> write_png(const std::filesystem::path& file, const Image& image);

/// Where a force method is looked at: a square section along the patient's axes.
struct ForceArrowsRequest {
  AnatomicalPlane plane = AnatomicalPlane::kAxial;
  Point<Patient> centre;
  double size_mm = 20;
  double spacing_mm = 0;  ///< between arrows; 0: size_mm / kArrowsPerSide
};
inline constexpr int kArrowsPerSide = 24, kMostArrowsPerSide = 200;

/// The forces of one method on a grid of points in a section, as a self-contained SVG: arrows over the scan
/// and the structures, lines of equal value, a scale for forces and one for lengths, orientation letters,
/// and what it is a picture of. Structures' names are in it, no title and no path.
/// @param method  the model is prepared for it (Model::has)
/// Errors: kBadInput for a centre outside the volume and for more arrows than kMostArrowsPerSide each way,
/// with "centre" or "spacing" as the place; kInterrupted.
Result<std::string> force_arrows_svg(const Model& model, ForceMethod method,
                                     const ForceArrowsRequest& request, const Progress& progress = {});
/// Written whole or not at all.
Result<void> write_force_arrows(const std::filesystem::path& file, const Model& model, ForceMethod method,
                                const ForceArrowsRequest& request, const Progress& progress = {});

}  // namespace palpate
