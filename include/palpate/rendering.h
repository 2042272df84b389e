#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "palpate/haptics.h"
#include "palpate/progress.h"
#include "palpate/result.h"

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
  Point<Patient> at(double column, double row) const;             ///< pixel (centre 0,0) to patient
  std::array<double, 2> pixel_of(const Point<Patient>& p) const;  ///< projected onto the plane
};

enum class AnatomicalPlane { kAxial, kSagittal, kCoronal };
/// A radiological view through `centre`: patient's left on picture right in axial and coronal, anterior
/// on picture left in sagittal.
SectionPlane anatomical_section(AnatomicalPlane plane, const Point<Patient>& centre, double width_mm,
                                int width_px, int height_px);

/// Letters for the directions a view's edges point to, e.g. "L", or "LA" when oblique by more than 20
/// degrees: left, right, top, bottom of the picture.
struct OrientationLetters {
  std::string left, right, top, bottom;
};
OrientationLetters orientation_letters(const SectionPlane& plane);

struct SectionStyle {
  double window_low = 0, window_high = 0;  ///< of the scan; equal: scan_window()
  double label_opacity = 0.55;             ///< of the colour over the scan, 0 ... 1, times the tissue's own
  bool outlines = true;                    ///< draw structures' borders at full colour
  int grey_levels = 256;                   ///< 2 ... 256; fewer make a smaller PNG
};
/// Renders scan (grey, linear) and labels (nearest neighbour, structure colours) in a plane: the scan
/// layer with the structure layer over it. Without a scan, and outside it, a dark neutral background.
Image render_section(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});

/// The 1st and 99th percentile of a scan's finite values, from at most about a million of them evenly
/// spread over the volume; {0, 1} when there is no spread.
std::array<double, 2> scan_window(const Volume<float>& scan);

/// An 8-bit RGBA picture, row 0 on top, colours not multiplied by alpha.
struct Overlay {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  ///< 4 * width * height
};
/// The two layers of render_section, for pages that blend them themselves.
Image render_scan_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});
Overlay render_structure_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style = {});
/// The structure in each pixel, row by row; 0 for none and outside the volume.
std::vector<LabelId> section_labels(const Model& model, const SectionPlane& plane);

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
