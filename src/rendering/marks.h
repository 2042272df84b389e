#pragma once

#include <string>
#include <vector>

#include "palpate/rendering/rendering.h"

/// What pictures of a section say about it.
namespace palpate::marks {

/// Whether a point lies in the volume's box, borders included.
bool reaches(const GridGeometry& grid, const Point<Patient>& p);
/// "1.0, 2.0, 3.0"
std::string point_text(const Point<Patient>& p);
/// The error for a point that the volume does not reach; "centre" is the place.
Error not_reached(const GridGeometry& grid, const Point<Patient>& p);

/// The longest of 1, 2 and 5 times a power of ten that takes at most a quarter of a picture.
double scale_bar_mm(double width_mm);

/// A structure's name as it may stand in a picture: not too long, and of plain letters, because a file may
/// hold bytes that are no text at all; else its number.
std::string short_name(const Model& model, LabelId label, std::size_t longest = 26);
/// The structures of a section, the largest first.
std::vector<LabelId> largest_first(const std::vector<LabelId>& labels);

}  // namespace palpate::marks
