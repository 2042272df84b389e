#include "rendering/bitmap_font.h"

#include <array>

namespace palpate::bitmap_font {
namespace {

constexpr char kFirst = ' ', kLast = '~';

/// Rows from the top, seven above the base line and two below, '/' after each.
// clang-format off
constexpr std::string_view kGlyphs[] = {
    "",  // space
    "  #/  #/  #/  #/  #//  #",  // !
    " # #/ # #/ # #",  // "
    " # #/ # #/#####/ # #/#####/ # #/ # #",  // #
    "  #/ ####/# #/ ###/  # #/####/  #",  // $
    "##/##  #/   #/  #/ #/#  ##/   ##",  // %
    " ##/#  #/# #/ #/# # #/#  #/ ## #",  // &
    "  #/  #/  #",  // '
    "   #/  #/ #/ #/ #/  #/   #",  // (
    " #/  #/   #/   #/   #/  #/ #",  // )
    "/  #/# # #/ ###/# # #/  #",  // *
    "/  #/  #/#####/  #/  #",  // +
    "///// ##/ ##/  #/ #",  // ,
    "///#####",  // -
    "///// ##/ ##",  // .
    "    #/    #/   #/  #/ #/#/#",  // /
    " ###/#   #/#  ##/# # #/##  #/#   #/ ###",  // 0
    "  #/ ##/  #/  #/  #/  #/ ###",  // 1
    " ###/#   #/    #/   #/  #/ #/#####",  // 2
    " ###/#   #/    #/  ##/    #/#   #/ ###",  // 3
    "   #/  ##/ # #/#  #/#####/   #/   #",  // 4
    "#####/#/####/    #/    #/#   #/ ###",  // 5
    "  ##/ #/#/####/#   #/#   #/ ###",  // 6
    "#####/    #/   #/  #/ #/ #/ #",  // 7
    " ###/#   #/#   #/ ###/#   #/#   #/ ###",  // 8
    " ###/#   #/#   #/ ####/    #/   #/ ##",  // 9
    "/ ##/ ##// ##/ ##",  // :
    "/ ##/ ##// ##/ ##/  #/ #",  // ;
    "   #/  #/ #/#/ #/  #/   #",  // <
    "//#####//#####",  // =
    " #/  #/   #/    #/   #/  #/ #",  // >
    " ###/#   #/    #/   #/  #//  #",  // ?
    " ###/#   #/# ###/# # #/# ###/#/ ###",  // @
    " ###/#   #/#   #/#####/#   #/#   #/#   #",  // A
    "####/#   #/#   #/####/#   #/#   #/####",  // B
    " ###/#   #/#/#/#/#   #/ ###",  // C
    "####/#   #/#   #/#   #/#   #/#   #/####",  // D
    "#####/#/#/####/#/#/#####",  // E
    "#####/#/#/####/#/#/#",  // F
    " ###/#   #/#/# ###/#   #/#   #/ ####",  // G
    "#   #/#   #/#   #/#####/#   #/#   #/#   #",  // H
    " ###/  #/  #/  #/  #/  #/ ###",  // I
    "  ###/   #/   #/   #/   #/#  #/ ##",  // J
    "#   #/#  #/# #/##/# #/#  #/#   #",  // K
    "#/#/#/#/#/#/#####",  // L
    "#   #/## ##/# # #/# # #/#   #/#   #/#   #",  // M
    "#   #/##  #/# # #/#  ##/#   #/#   #/#   #",  // N
    " ###/#   #/#   #/#   #/#   #/#   #/ ###",  // O
    "####/#   #/#   #/####/#/#/#",  // P
    " ###/#   #/#   #/#   #/# # #/#  #/ ## #",  // Q
    "####/#   #/#   #/####/# #/#  #/#   #",  // R
    " ###/#   #/#/ ###/    #/#   #/ ###",  // S
    "#####/  #/  #/  #/  #/  #/  #",  // T
    "#   #/#   #/#   #/#   #/#   #/#   #/ ###",  // U
    "#   #/#   #/#   #/#   #/#   #/ # #/  #",  // V
    "#   #/#   #/#   #/# # #/# # #/## ##/#   #",  // W
    "#   #/#   #/ # #/  #/ # #/#   #/#   #",  // X
    "#   #/#   #/ # #/  #/  #/  #/  #",  // Y
    "#####/    #/   #/  #/ #/#/#####",  // Z
    " ###/ #/ #/ #/ #/ #/ ###",  // [
    "#/#/ #/  #/   #/    #/    #",  // backslash
    " ###/   #/   #/   #/   #/   #/ ###",  // ]
    "  #/ # #/#   #",  // ^
    "///////#####",  // _
    " #/  #",  // `
    "// ###/    #/ ####/#   #/ ####",  // a
    "#/#/####/#   #/#   #/#   #/####",  // b
    "// ###/#   #/#/#   #/ ###",  // c
    "    #/    #/ ####/#   #/#   #/#   #/ ####",  // d
    "// ###/#   #/#####/#/ ###",  // e
    "  ##/ #  #/ #/###/ #/ #/ #",  // f
    "// ####/#   #/#   #/#   #/ ####/    #/ ###",  // g
    "#/#/# ##/##  #/#   #/#   #/#   #",  // h
    "  #// ##/  #/  #/  #/ ###",  // i
    "   #//  ##/   #/   #/   #/   #/#  #/ ##",  // j
    "#/#/#  #/# #/##/# #/#  #",  // k
    " ##/  #/  #/  #/  #/  #/ ###",  // l
    "//## #/# # #/# # #/# # #/# # #",  // m
    "//# ##/##  #/#   #/#   #/#   #",  // n
    "// ###/#   #/#   #/#   #/ ###",  // o
    "//####/#   #/#   #/#   #/####/#/#",  // p
    "// ####/#   #/#   #/#   #/ ####/    #/    #",  // q
    "//# ##/##  #/#/#/#",  // r
    "// ####/#/ ###/    #/####",  // s
    " #/ #/###/ #/ #/ #  #/  ##",  // t
    "//#   #/#   #/#   #/#  ##/ ## #",  // u
    "//#   #/#   #/#   #/ # #/  #",  // v
    "//#   #/#   #/# # #/# # #/ # #",  // w
    "//#   #/ # #/  #/ # #/#   #",  // x
    "//#   #/#   #/#   #/#   #/ ####/    #/ ###",  // y
    "//#####/   #/  #/ #/#####",  // z
    "   ##/  #/  #/ #/  #/  #/   ##",  // {
    "  #/  #/  #/  #/  #/  #/  #",  // |
    "##/  #/  #/   #/  #/  #/##",  // }
    "// #/# # #/   #",  // ~
};
// clang-format on
static_assert(std::size(kGlyphs) == kLast - kFirst + 1);

using Glyph = std::array<std::array<bool, kWidth>, kHeight>;

constexpr Glyph glyph_of(char character) {
  Glyph glyph{};
  int row = 0, column = 0;
  for (const char dot : kGlyphs[character - kFirst]) {
    if (dot == '/') {
      ++row;
      column = 0;
    } else {
      glyph[row][column++] = dot == '#';
    }
  }
  return glyph;
}

bool dot(const Glyph& glyph, int column, int row) {
  return column >= 0 && row >= 0 && column < kWidth && row < kHeight && glyph[row][column];
}

/// A quarter of a dot, on its sides `across` and `down` (-1 or 1). Enlarged by Scale2x: a quarter between two
/// dots that meet at its corner takes their value, so that diagonals and curves are smooth.
bool quarter(const Glyph& glyph, int column, int row, int across, int down) {
  const bool self = dot(glyph, column, row);
  const bool beside = dot(glyph, column + across, row), opposite = dot(glyph, column - across, row);
  const bool above = dot(glyph, column, row + down), below = dot(glyph, column, row - down);
  return beside == above && beside != below && above != opposite ? above : self;
}

void set(Image& image, int x, int y, const Rgb& colour) {
  if (x < 0 || y < 0 || x >= image.width || y >= image.height) return;
  std::uint8_t* pixel = &image.rgb[3 * (static_cast<std::size_t>(y) * image.width + x)];
  pixel[0] = colour.r;
  pixel[1] = colour.g;
  pixel[2] = colour.b;
}

/// Calls visit(x, y) for every pixel of the text.
template <class Visit>
void for_each_pixel(std::string_view text, int scale, Visit visit) {
  int left = 0;
  for (const char character : text) {
    const Glyph glyph = glyph_of(character >= kFirst && character <= kLast ? character : '?');
    for (int y = 0; y < scale * kHeight; ++y) {
      for (int x = 0; x < scale * kWidth; ++x) {
        const int across = 2 * (x % scale) < scale - 1 ? -1 : 1, down = 2 * (y % scale) < scale - 1 ? -1 : 1;
        const bool on = scale == 1 ? dot(glyph, x, y) : quarter(glyph, x / scale, y / scale, across, down);
        if (on) visit(left + x, y);
      }
    }
    left += scale * kAdvance;
  }
}

}  // namespace

int width_px(std::string_view text, int scale) {
  return text.empty() ? 0 : scale * (kAdvance * static_cast<int>(text.size()) - (kAdvance - kWidth));
}

void draw(Image& image, int left, int top, std::string_view text, int scale, const Rgb& colour) {
  PALPATE_CHECK(scale >= 1);
  for_each_pixel(text, scale, [&](int x, int y) {
    for (int dy = -scale; dy <= scale; ++dy)
      for (int dx = -scale; dx <= scale; ++dx) set(image, left + x + dx, top + y + dy, Rgb{0, 0, 0});
  });
  for_each_pixel(text, scale, [&](int x, int y) { set(image, left + x, top + y, colour); });
}

}  // namespace palpate::bitmap_font
