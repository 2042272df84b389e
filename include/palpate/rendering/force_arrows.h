#pragma once

#include <array>
#include <string>
#include <vector>

#include "palpate/direct/force_field.h"
#include "palpate/rendering/rendering.h"

/// Parts of the picture of a force method: sampling in a section, and page layout.
namespace palpate::force_arrows {

using Pixel = std::array<double, 2>;  ///< Section or page coordinates: right, down; px

/// Force at a point of a section.
struct Arrow {
  Pixel at{};
  double right_N = 0, down_N = 0;
  double away_N = 0;  ///< Component out of the plane, away from the viewer
  double value = 0;   ///< Value of the field, 0 ... 1

  double force_N() const;
  double in_plane_N() const;
};

/// Forces on a grid centred in the section, row by row; an odd number of arrows per side puts one in the
/// centre. If interrupted, the result is incomplete.
std::vector<Arrow> sample_arrows(const ForceField& field, const SectionPlane& plane, double spacing_mm,
                                 const Progress& progress = {});

/// Number of arrows along a side of the section, at least one; may be too many to draw.
double arrows_per_side(double size_mm, double spacing_mm);

/// Straight piece of a contour line, in section coordinates.
struct ContourSegment {
  Pixel from{}, to{};
};

/// Field values at the corners of square cells over a section.
class ValueGrid {
 public:
  ValueGrid(const ForceField& field, const SectionPlane& plane, int cells, const Progress& progress = {});
  /// Contour line of a level by marching squares: one or two segments for every cell that it crosses.
  std::vector<ContourSegment> contour(double level) const;

 private:
  double at(int column, int row) const {
    return values_[static_cast<std::size_t>(row) * (cells_ + 1) + column];
  }
  void add_cell(int column, int row, double level, std::vector<ContourSegment>& segments) const;

  int cells_;
  double cell_px_;
  std::vector<double> values_;
};

/// Content of the page.
struct Picture {
  const Model& model;
  const ForceField& field;
  AnatomicalPlane plane;
  SectionPlane section;
  double spacing_mm = 1;
};
/// Page as SVG.
std::string draw(const Picture& picture, const Progress& progress);

/// Side length of the section on the page.
inline constexpr int kSection_px = 540;

}  // namespace palpate::force_arrows
