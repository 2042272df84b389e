#include <png.h>

#include <array>
#include <csetjmp>
#include <cstring>
#include <string>

#include "volume_io/image/image.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

struct Source {
  std::string_view bytes;
  std::size_t at = 0;
};

void read_bytes(png_structp png, png_bytep into, png_size_t count) {
  auto& source = *static_cast<Source*>(png_get_io_ptr(png));
  if (count > source.bytes.size() - source.at) png_error(png, "end of file");
  std::memcpy(into, source.bytes.data() + source.at, count);
  source.at += count;
}

[[noreturn]] void fail(png_structp png, png_const_charp) {
  png_longjmp(png, 1);
}

void ignore(png_structp, png_const_charp) {}

// Decodes into rows of `row_bytes` each. No object with a destructor may live in this function, which libpng
// leaves by longjmp(). Returns false if the data are damaged.
bool decode(Source* source, png_bytep* rows, std::size_t row_bytes, png_structp png, png_infop info) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_set_read_fn(png, source, read_bytes);
  constexpr png_uint_32 kMaxAlong = 1 << 20, kMaxChunk = 1 << 23;
  png_set_user_limits(png, kMaxAlong, kMaxAlong);
  png_set_chunk_malloc_max(png, kMaxChunk);
  // text and profiles, which may be large or damaged, are not needed
  png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_NEVER, nullptr, -1);
  png_read_info(png, info);
  const int type = png_get_color_type(png, info), bits = png_get_bit_depth(png, info);
  if (type == PNG_COLOR_TYPE_PALETTE) {
    png_set_palette_to_rgb(png);
  } else if (type == PNG_COLOR_TYPE_GRAY && bits < 8) {
    png_set_packing(png);
  } else if ((type & PNG_COLOR_MASK_COLOR) != 0 && bits == 16) {
    png_set_scale_16(png);
  }
  // colour images retain transparency, grey images do not
  if ((type & PNG_COLOR_MASK_COLOR) != 0) {
    if (png_get_valid(png, info, PNG_INFO_tRNS)) png_set_tRNS_to_alpha(png);
    png_set_add_alpha(png, 0xFF, PNG_FILLER_AFTER);
  } else {
    png_set_strip_alpha(png);
  }
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  if (png_get_rowbytes(png, info) != row_bytes) return false;
  png_read_image(png, rows);
  png_read_end(png, nullptr);
  return true;
}

class PngDecoder : public ImageDecoder {
 public:
  PngDecoder(std::string bytes, const ImageShape& shape) : bytes_(std::move(bytes)) { pages_ = {shape}; }

  Result<void> read(std::size_t, std::span<std::uint32_t> pixels) override {
    const ImageShape& shape = pages_.front();
    const std::size_t pixel_bytes = shape.colour ? 4 : bytes_of(shape.component),
                      row_bytes = pixel_bytes * static_cast<std::size_t>(shape.columns);
    std::vector<png_byte> values(row_bytes * static_cast<std::size_t>(shape.rows));
    std::vector<png_bytep> rows;
    for (int j = 0; j < shape.rows; ++j)
      rows.push_back(values.data() + static_cast<std::size_t>(j) * row_bytes);
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, fail, ignore);
    png_infop info = png ? png_create_info_struct(png) : nullptr;
    Source source{bytes_};
    const bool whole = info && decode(&source, rows.data(), row_bytes, png, info);
    if (png) png_destroy_read_struct(&png, &info, nullptr);
    if (!whole) return bad_input("", kDamagedImage, kCopyImage);
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      const png_byte* value = values.data() + n * pixel_bytes;
      if (!shape.colour)
        pixels[n] = pixel_bytes == 1 ? value[0] : static_cast<std::uint32_t>(value[0] << 8 | value[1]);
      else
        pixels[n] = value[3] == 0 ? 0 : static_cast<std::uint32_t>(value[0] << 16 | value[1] << 8 | value[2]);
    }
    return {};
  }

 private:
  std::string bytes_;
};

std::uint32_t big_at(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t n = 0; n < 4; ++n) value = value << 8 | static_cast<unsigned char>(bytes[at + n]);
  return value;
}

}  // namespace

Result<std::unique_ptr<ImageDecoder>> open_png(ImageBytes source) {
  if (source.size > kMaxImageBytes)
    return bad_input("", "is a PNG file of more than 512 MiB", "save it as TIFF");
  std::string bytes(static_cast<std::size_t>(source.size), '\0');
  constexpr std::size_t kHeader = 33;
  if (bytes.size() < kHeader || !source.read(0, std::as_writable_bytes(std::span(bytes))) ||
      bytes.substr(12, 4) != "IHDR")
    return bad_input("", kDamagedImage, kCopyImage);
  const std::uint32_t columns = big_at(bytes, 16), rows = big_at(bytes, 20);
  if (auto possible = check_image_size(columns, rows); !possible) return possible.error();
  const auto bits = static_cast<unsigned char>(bytes[24]), type = static_cast<unsigned char>(bytes[25]);
  ImageShape shape;
  shape.columns = static_cast<int>(columns);
  shape.rows = static_cast<int>(rows);
  shape.colour = (type & PNG_COLOR_MASK_COLOR) != 0;
  shape.component = bits == 16 && !shape.colour ? Component::kUint16 : Component::kUint8;
  return std::unique_ptr<ImageDecoder>(std::make_unique<PngDecoder>(std::move(bytes), shape));
}

}  // namespace palpate::volume_io
