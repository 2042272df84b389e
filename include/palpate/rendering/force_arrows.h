#pragma once

#include <array>
#include <string>
#include <vector>

#include "palpate/rendering/rendering.h"

/// A force method's picture in parts: what is sampled in a section, and how it is laid out on the page.
namespace palpate::force_arrows {

using Pixel = std::array<double, 2>;  ///< of the section, or of the page: across, down

/// The force at one point of a section.
struct Arrow {
  Pixel at{};
  double right_N = 0, down_N = 0;
  double away_N = 0;  ///< out of the plane, away from the viewer
  double value = 0;   ///< of the field, 0 ... 1

  double force_N() const;
  double in_plane_N() const;
};

/// Forces on a grid that is centred in the section, row by row; a grid has an arrow in the middle where an
/// odd number of them fits.
/// Interrupted, it has fewer.
std::vector<Arrow> sample_arrows(const ForceField& field, const SectionPlane& plane, double spacing_mm,
                                 const Progress& progress = {});

/// How many arrows fit along a side of the section, at least one; may be too many to draw.
double arrows_per_side(double size_mm, double spacing_mm);

struct Stretch {
  Pixel from{}, to{};
};
/// Values at the corners of square cells over a section.
class ValueGrid {
 public:
  ValueGrid(const ForceField& field, const SectionPlane& plane, int cells, const Progress& progress = {});
  /// Where the value crosses a level, a stretch or two for every cell it crosses.
  std::vector<Stretch> contour(double level) const;

 private:
  double at(int column, int row) const {
    return values_[static_cast<std::size_t>(row) * (cells_ + 1) + column];
  }
  void add_cell(int column, int row, double level, std::vector<Stretch>& stretches) const;

  int cells_;
  double cell_px_;
  std::vector<double> values_;
};

/// Everything that the page shows.
struct Picture {
  const Model& model;
  const ForceField& field;
  AnatomicalPlane plane;
  SectionPlane section;
  double spacing_mm = 1;
};
/// The page, as SVG.
std::string draw(const Picture& picture, const Progress& progress);

/// Side of the section on the page.
inline constexpr int kSection_px = 540;

}  // namespace palpate::force_arrows
