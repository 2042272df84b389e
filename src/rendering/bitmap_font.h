#pragma once

#include <string_view>

#include "palpate/rendering/rendering.h"

/// Letters of whole pixels, drawn for palpate's pictures: printable ASCII, "?" for anything else.
namespace palpate::bitmap_font {

/// Dots of a letter, two rows of them below the base line, and from one letter to the next.
inline constexpr int kWidth = 5, kHeight = 9, kBaseline = 7, kAdvance = 6;

/// @param scale  pixels a dot
int width_px(std::string_view text, int scale);
/// With a dark rim a dot wide, to be read on any background. What lies beyond the picture is cut off.
void draw(Image& image, int left, int top, std::string_view text, int scale, const Rgb& colour);

}  // namespace palpate::bitmap_font
