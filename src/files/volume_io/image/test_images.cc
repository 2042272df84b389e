#include "volume_io/image/test_images.h"

#include <png.h>
#include <zlib.h>

#include <cstdio>
// jpeglib.h requires the headers above
#include <jpeglib.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <map>

#include "palpate/base/check.h"

namespace palpate::test {
namespace {

// ---- TIFF ------------------------------------------------------------------------------------------

using Bytes = std::string;

// TIFF 6.0 section 13
Bytes pack_lzw(const Bytes& plain) {
  Bytes out;
  std::uint32_t bit_buffer = 0;
  int bits = 0;
  unsigned width = 9, next = 258;
  const auto put = [&](unsigned code) {
    bit_buffer = bit_buffer << width | code;
    bits += static_cast<int>(width);
    while (bits >= 8) {
      out += static_cast<char>(bit_buffer >> (bits - 8) & 0xFF);
      bits -= 8;
    }
  };
  std::map<Bytes, unsigned> table;
  const auto clear = [&] {
    put(256);
    table.clear();
    for (unsigned n = 0; n < 256; ++n) table[Bytes(1, static_cast<char>(n))] = n;
    next = 258;
    width = 9;
  };
  clear();
  Bytes run;
  for (const char c : plain) {
    if (table.contains(run + c)) {
      run += c;
      continue;
    }
    put(table[run]);
    table[run + c] = next++;
    if (next == 4094) {
      run = Bytes(1, c);
      put(table[run]);
      run.clear();
      clear();
      continue;
    }
    if (next == (1u << width)) ++width;
    run = Bytes(1, c);
  }
  if (!run.empty()) {
    put(table[run]);
    ++next;
    if (next == (1u << width)) ++width;
  }
  put(257);
  if (bits > 0) out += static_cast<char>(bit_buffer << (8 - bits) & 0xFF);
  return out;
}

Bytes pack_bits(const Bytes& plain) {
  Bytes out;
  for (std::size_t at = 0; at < plain.size();) {
    std::size_t same = 1;
    while (at + same < plain.size() && same < 128 && plain[at + same] == plain[at]) ++same;
    if (same > 1) {
      out += static_cast<char>(1 - static_cast<int>(same));
      out += plain[at];
    } else {
      out += '\0';
      out += plain[at];
    }
    at += same;
  }
  return out;
}

Bytes deflate(const Bytes& plain) {
  uLongf length = ::compressBound(plain.size());
  Bytes out(length, '\0');
  PALPATE_CHECK(::compress(reinterpret_cast<Bytef*>(out.data()), &length,
                           reinterpret_cast<const Bytef*>(plain.data()), plain.size()) == Z_OK);
  out.resize(length);
  return out;
}

class TiffWriter {
 public:
  explicit TiffWriter(const TiffLayout& layout) : layout_(layout) {}

  Bytes write(const std::vector<Picture>& pages) {
    text_ = layout_.big_endian ? "MM" : "II";
    number(layout_.big_tiff ? 43 : 42, 2);
    if (layout_.big_tiff) {
      number(8, 2);
      number(0, 2);
    }
    link_ = text_.size();
    offset(0);
    for (const Picture& page : pages) put_page(page);
    return text_;
  }

 private:
  std::size_t offset_bytes() const { return layout_.big_tiff ? 8 : 4; }
  Bytes as_bytes(std::uint64_t value, std::size_t bytes) const {
    Bytes out;
    for (std::size_t n = 0; n < bytes; ++n) out += static_cast<char>(value >> (8 * n) & 0xFF);
    if (layout_.big_endian) std::ranges::reverse(out);
    return out;
  }
  void number(std::uint64_t value, std::size_t bytes) { text_ += as_bytes(value, bytes); }
  void offset(std::uint64_t value) { number(value, offset_bytes()); }
  int samples() const { return layout_.colour ? 3 : 1; }

  // samples of a region of a page, as stored
  Bytes rows_of(const Picture& page, int left, int top, int columns, int rows, int plane) const {
    const std::size_t sample_bytes = static_cast<std::size_t>(std::max(layout_.bits, 8)) / 8;
    Bytes out;
    for (int j = 0; j < rows; ++j) {
      std::vector<std::uint32_t> row;
      for (int i = 0; i < columns; ++i) {
        const bool beyond = left + i >= page.columns || top + j >= page.rows;
        std::uint32_t pixel =
            beyond ? 0 : page.pixels[static_cast<std::size_t>((top + j) * page.columns + left + i)];
        if (layout_.white_is_zero) pixel = ((1u << layout_.bits) - 1) - pixel;
        for (int s = 0; s < samples(); ++s) {
          if (layout_.separate && s != plane) continue;
          std::uint32_t value = layout_.colour ? pixel >> (8 * (2 - s)) & 0xFF : pixel;
          if (layout_.colour && layout_.bits == 16) value = value << 8 | 0x5A;
          row.push_back(value);
        }
      }
      if (layout_.predicted) {
        const int apart = layout_.separate ? 1 : samples();
        for (std::size_t n = row.size(); n-- > static_cast<std::size_t>(apart);)
          row[n] -= row[n - static_cast<std::size_t>(apart)];
      }
      if (layout_.bits >= 8) {
        for (const std::uint32_t value : row) out += as_bytes(value, sample_bytes);
        continue;
      }
      unsigned bit_buffer = 0;
      int bits = 0;
      for (const std::uint32_t value : row) {
        bit_buffer = bit_buffer << layout_.bits | value;
        bits += layout_.bits;
        if (bits == 8) {
          out += static_cast<char>(bit_buffer);
          bit_buffer = 0;
          bits = 0;
        }
      }
      if (bits > 0) out += static_cast<char>(bit_buffer << (8 - bits));
    }
    return out;
  }
  Bytes packed(const Bytes& plain) const {
    switch (layout_.packing) {
      case TiffLayout::Packing::kLzw:
        return pack_lzw(plain);
      case TiffLayout::Packing::kDeflate:
        return deflate(plain);
      case TiffLayout::Packing::kPackBits:
        return pack_bits(plain);
      default:
        return plain;
    }
  }

  void put_page(const Picture& page) {
    constexpr int kTile = 16;
    std::vector<std::uint64_t> offsets, counts;
    for (int plane = 0; plane < (layout_.separate ? samples() : 1); ++plane) {
      const int width = layout_.tiled ? kTile : page.columns,
                height = layout_.tiled ? kTile : layout_.rows_per_strip;
      for (int top = 0; top < page.rows; top += height)
        for (int left = 0; left < page.columns; left += width) {
          const int rows = layout_.tiled ? kTile : std::min(height, page.rows - top);
          const Bytes piece = packed(rows_of(page, left, top, width, rows, plane));
          offsets.push_back(text_.size());
          counts.push_back(piece.size());
          text_ += piece;
          if (text_.size() % 2) text_ += '\0';
        }
    }
    struct Field {
      std::uint16_t tag, type;
      std::vector<std::uint64_t> values;
    };
    const std::uint16_t wide = layout_.big_tiff ? 16 : 4;
    constexpr std::array<std::uint64_t, 4> kPackings{1, 5, 8, 32773};
    std::vector<Field> fields{{256, 4, {static_cast<std::uint64_t>(page.columns)}},
                              {257, 4, {static_cast<std::uint64_t>(page.rows)}},
                              {258, 3,
                               std::vector<std::uint64_t>(static_cast<std::size_t>(samples()),
                                                          static_cast<std::uint64_t>(layout_.bits))},
                              {259, 3, {kPackings[static_cast<std::size_t>(layout_.packing)]}},
                              {262,
                               3,
                               {layout_.colour          ? 2u
                                : layout_.palette       ? 3u
                                : layout_.white_is_zero ? 0u
                                                        : 1u}}};
    if (!layout_.tiled) fields.push_back({273, wide, offsets});
    fields.push_back({277, 3, {static_cast<std::uint64_t>(samples())}});
    if (!layout_.tiled) {
      fields.push_back({278, 3, {static_cast<std::uint64_t>(layout_.rows_per_strip)}});
      fields.push_back({279, wide, counts});
    }
    fields.push_back({284, 3, {layout_.separate ? 2u : 1u}});
    if (layout_.predicted) fields.push_back({317, 3, {2}});
    if (layout_.palette) {
      // entry n is 0xn0n1n2, with 16 bits per component
      std::vector<std::uint64_t> map;
      for (std::uint64_t c = 0; c < 3; ++c)
        for (std::uint64_t n = 0; n < (std::uint64_t{1} << layout_.bits); ++n)
          map.push_back(n == 0 ? 0 : ((n * 16 + c) & 0xFF) * 257);
      fields.push_back({320, 3, map});
    }
    if (layout_.tiled) {
      fields.push_back({322, 3, {kTile}});
      fields.push_back({323, 3, {kTile}});
      fields.push_back({324, wide, offsets});
      fields.push_back({325, wide, counts});
    }
    if (layout_.is_float) fields.push_back({339, 3, {3}});

    Bytes entries;
    for (const Field& field : fields) {
      const std::size_t each = field.type == 3 ? 2 : field.type == 4 ? 4 : 8;
      Bytes values;
      for (const std::uint64_t value : field.values) values += as_bytes(value, each);
      entries +=
          as_bytes(field.tag, 2) + as_bytes(field.type, 2) + as_bytes(field.values.size(), offset_bytes());
      if (values.size() > offset_bytes()) {
        const std::size_t at = text_.size();
        text_ += values;
        values = as_bytes(at, offset_bytes());
      }
      values.resize(offset_bytes(), '\0');
      entries += values;
    }
    text_.replace(link_, offset_bytes(), as_bytes(text_.size(), offset_bytes()));
    number(fields.size(), layout_.big_tiff ? 8 : 2);
    text_ += entries;
    link_ = text_.size();
    offset(0);
  }

  const TiffLayout& layout_;
  Bytes text_;
  std::size_t link_ = 0;  // position of the offset of the next directory
};

// ---- PNG -------------------------------------------------------------------------------------------

void append(png_structp png, png_bytep bytes, png_size_t count) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<char*>(bytes), count);
}
void nothing(png_structp) {}

}  // namespace

Picture some_picture(std::uint32_t end, std::uint32_t seed, int columns, int rows) {
  Picture picture{columns, rows, {}};
  for (int n = 0; n < columns * rows; ++n)
    picture.pixels.push_back((static_cast<std::uint32_t>(n) * 2654435761u + seed * 40503u) / 7 % end);
  return picture;
}

std::string png_of(const Picture& picture, PngKind kind) {
  std::string text;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(png, &text, append, nothing);
  int type = PNG_COLOR_TYPE_GRAY, bits = 8;
  if (kind == PngKind::kGrey16) bits = 16;
  if (kind == PngKind::kGrey4) bits = 4;
  if (kind == PngKind::kGreyAlpha) type = PNG_COLOR_TYPE_GRAY_ALPHA;
  if (kind == PngKind::kRgb) type = PNG_COLOR_TYPE_RGB;
  if (kind == PngKind::kRgba) type = PNG_COLOR_TYPE_RGB_ALPHA;
  if (kind == PngKind::kPalette) type = PNG_COLOR_TYPE_PALETTE;
  png_set_IHDR(png, info, static_cast<png_uint_32>(picture.columns), static_cast<png_uint_32>(picture.rows),
               bits, type, kind == PngKind::kInterlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  std::vector<std::uint32_t> palette;
  if (kind == PngKind::kPalette) {
    palette = picture.pixels;
    std::ranges::sort(palette);
    palette.erase(std::unique(palette.begin(), palette.end()), palette.end());
    std::vector<png_color> colours;
    for (const std::uint32_t c : palette)
      colours.push_back(
          {static_cast<png_byte>(c >> 16), static_cast<png_byte>(c >> 8), static_cast<png_byte>(c)});
    png_set_PLTE(png, info, colours.data(), static_cast<int>(colours.size()));
  }
  png_write_info(png, info);
  if (kind == PngKind::kGrey4) png_set_packing(png);
  std::vector<std::vector<png_byte>> rows;
  for (int j = 0; j < picture.rows; ++j) {
    auto& row = rows.emplace_back();
    for (int i = 0; i < picture.columns; ++i) {
      const std::uint32_t pixel = picture.pixels[static_cast<std::size_t>(j * picture.columns + i)];
      switch (kind) {
        case PngKind::kGrey16:
          row.insert(row.end(), {static_cast<png_byte>(pixel >> 8), static_cast<png_byte>(pixel)});
          break;
        case PngKind::kGreyAlpha:
          row.insert(row.end(), {static_cast<png_byte>(pixel), 77});
          break;
        case PngKind::kRgb:
        case PngKind::kRgba:
          row.insert(row.end(), {static_cast<png_byte>(pixel >> 16), static_cast<png_byte>(pixel >> 8),
                                 static_cast<png_byte>(pixel)});
          // black is transparent, with another colour
          if (kind == PngKind::kRgba) row.push_back(pixel == 0 ? 0 : 255);
          if (kind == PngKind::kRgba && pixel == 0) row[row.size() - 2] = 200;
          break;
        case PngKind::kPalette:
          row.push_back(static_cast<png_byte>(std::ranges::lower_bound(palette, pixel) - palette.begin()));
          break;
        default:
          row.push_back(static_cast<png_byte>(pixel));
      }
    }
  }
  std::vector<png_bytep> pointers;
  for (auto& row : rows) pointers.push_back(row.data());
  png_write_image(png, pointers.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  return text;
}

std::string jpeg_of(const Picture& picture, bool colour, int quality) {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* bytes = nullptr;
  unsigned long count = 0;
  jpeg_mem_dest(&jpeg, &bytes, &count);
  jpeg.image_width = static_cast<JDIMENSION>(picture.columns);
  jpeg.image_height = static_cast<JDIMENSION>(picture.rows);
  jpeg.input_components = colour ? 3 : 1;
  jpeg.in_color_space = colour ? JCS_RGB : JCS_GRAYSCALE;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, quality, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  for (int j = 0; j < picture.rows; ++j) {
    std::vector<JSAMPLE> row;
    for (int i = 0; i < picture.columns; ++i) {
      const std::uint32_t pixel = picture.pixels[static_cast<std::size_t>(j * picture.columns + i)];
      if (colour) {
        row.push_back(static_cast<JSAMPLE>(pixel >> 16));
        row.push_back(static_cast<JSAMPLE>(pixel >> 8));
      }
      row.push_back(static_cast<JSAMPLE>(pixel));
    }
    JSAMPROW pointer = row.data();
    jpeg_write_scanlines(&jpeg, &pointer, 1);
  }
  jpeg_finish_compress(&jpeg);
  std::string text(reinterpret_cast<char*>(bytes), count);
  jpeg_destroy_compress(&jpeg);
  std::free(bytes);
  return text;
}

std::string tiff_of(const std::vector<Picture>& pages, const TiffLayout& layout) {
  return TiffWriter(layout).write(pages);
}

}  // namespace palpate::test
