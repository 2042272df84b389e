#pragma once

#include <string>
#include <vector>

#include "palpate/rendering/rendering.h"

/// Helpers for annotations of sections.
namespace palpate::marks {

/// Whether a point lies in the volume's bounding box, boundary included.
bool contains(const GridGeometry& grid, const Point<Patient>& p);
/// "1.0, 2.0, 3.0"
std::string point_text(const Point<Patient>& p);
/// Error for a point outside the volume, with the location "centre".
Error outside_error(const GridGeometry& grid, const Point<Patient>& p);

/// Largest of 1, 2 and 5 times a power of ten that is at most a quarter of the picture's width.
double scale_bar_mm(double width_mm);

/// Structure's name for display: truncated, plain ASCII, because a file may contain arbitrary bytes; without
/// a usable name, its number.
std::string short_name(const Model& model, LabelId label, std::size_t longest = 26);
/// Structures of a section by descending area.
std::vector<LabelId> largest_first(const std::vector<LabelId>& labels);

}  // namespace palpate::marks
