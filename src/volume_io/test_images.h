#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// Pictures, made by libpng, by libjpeg and, of TIFF, byte by byte, for tests of whoever reads them.
namespace palpate::test {

/// Pixels row by row. Of colours 0xRRGGBB.
struct Picture {
  int columns = 5, rows = 4;
  std::vector<std::uint32_t> pixels;
};
/// Another value for each pixel, below `end`.
Picture some_picture(std::uint32_t end, std::uint32_t seed = 0, int columns = 5, int rows = 4);

enum class PngKind { kGrey8, kGrey16, kGrey4, kGreyAlpha, kRgb, kRgba, kPalette, kInterlaced };
std::string png_of(const Picture& picture, PngKind kind);

/// @param quality  0 ... 100
std::string jpeg_of(const Picture& picture, bool colour, int quality = 100);

struct TiffLayout {
  enum class Packing { kNone, kLzw, kDeflate, kPackBits };
  Packing packing = Packing::kNone;
  bool big_endian = false, big_tiff = false, tiled = false, separate = false, predicted = false;
  bool white_is_zero = false, is_float = false, colour = false, palette = false;
  int bits = 8;
  int rows_per_strip = 3;
};
/// A page for each picture.
std::string tiff_of(const std::vector<Picture>& pages, const TiffLayout& layout);

}  // namespace palpate::test
