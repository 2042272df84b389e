#pragma once

#include <string_view>

#include "palpate/rendering/rendering.h"

/// Bitmap font for palpate's pictures: printable ASCII, "?" for anything else.
namespace palpate::bitmap_font {

/// Size of a glyph in dots, rows above the base line, and advance width.
inline constexpr int kWidth = 5, kHeight = 9, kBaseline = 7, kAdvance = 6;

/// @param scale  pixels per dot
int width_px(std::string_view text, int scale);
/// Draws text with a dark outline one dot wide, legible on any background. Clipped to the picture.
void draw(Image& image, int left, int top, std::string_view text, int scale, const Rgb& colour);

}  // namespace palpate::bitmap_font
