#include <png.h>

#include <cstring>
#include <unordered_map>

#include "palpate/base/file.h"
#include "palpate/rendering/rendering.h"

namespace palpate {
namespace {

/// Pixels as indices into at most 256 colours.
struct Palette {
  std::vector<std::uint8_t> indices;
  std::vector<std::uint8_t> entries;  ///< `channels` bytes each
};

/// Palette in order of first appearance; empty `entries` if there are too many colours.
Palette make_palette(const std::vector<std::uint8_t>& pixels, std::size_t channels) {
  Palette palette;
  palette.indices.reserve(pixels.size() / channels);
  std::unordered_map<std::uint32_t, std::uint8_t> known;
  for (std::size_t at = 0; at < pixels.size(); at += channels) {
    std::uint32_t colour = 0;
    std::memcpy(&colour, &pixels[at], channels);
    auto found = known.find(colour);
    if (found == known.end()) {
      if (known.size() == 256) return {};
      found = known.emplace(colour, static_cast<std::uint8_t>(known.size())).first;
      palette.entries.insert(palette.entries.end(), &pixels[at], &pixels[at] + channels);
    }
    palette.indices.push_back(found->second);
  }
  return palette;
}

/// Encodes a PNG; libpng's simplified writer adds neither text nor time.
std::vector<std::uint8_t> encode(int width, int height, std::uint32_t format,
                                 const std::vector<std::uint8_t>& pixels,
                                 const std::vector<std::uint8_t>& colour_map, std::size_t colours) {
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  header.width = static_cast<png_uint_32>(width);
  header.height = static_cast<png_uint_32>(height);
  header.format = format;
  header.colormap_entries = static_cast<png_uint_32>(colours);
  const void* map = colour_map.empty() ? nullptr : colour_map.data();

  // an upper bound of the size avoids compressing twice
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(header);
  std::vector<std::uint8_t> bytes(size);
  const int written = png_image_write_to_memory(&header, bytes.data(), &size, 0, pixels.data(), 0, map);
  PALPATE_CHECK(written != 0);
  bytes.resize(size);
  return bytes;
}

bool is_grey(const std::vector<std::uint8_t>& rgb) {
  for (std::size_t at = 0; at < rgb.size(); at += 3) {
    if (rgb[at] != rgb[at + 1] || rgb[at] != rgb[at + 2]) return false;
  }
  return true;
}

std::vector<std::uint8_t> every_third(const std::vector<std::uint8_t>& rgb) {
  std::vector<std::uint8_t> grey(rgb.size() / 3);
  for (std::size_t i = 0; i < grey.size(); ++i) grey[i] = rgb[3 * i];
  return grey;
}

}  // namespace

std::vector<std::uint8_t> encode_png(const Image& image) {
  PALPATE_CHECK(image.width > 0 && image.height > 0);
  PALPATE_CHECK(image.rgb.size() == 3 * static_cast<std::size_t>(image.width) * image.height);
  if (is_grey(image.rgb)) {
    return encode(image.width, image.height, PNG_FORMAT_GRAY, every_third(image.rgb), {}, 0);
  }
  const Palette palette = make_palette(image.rgb, 3);
  if (palette.entries.empty()) return encode(image.width, image.height, PNG_FORMAT_RGB, image.rgb, {}, 0);
  return encode(image.width, image.height, PNG_FORMAT_RGB_COLORMAP, palette.indices, palette.entries,
                palette.entries.size() / 3);
}

std::vector<std::uint8_t> encode_png(const Overlay& overlay) {
  PALPATE_CHECK(overlay.width > 0 && overlay.height > 0);
  PALPATE_CHECK(overlay.rgba.size() == 4 * static_cast<std::size_t>(overlay.width) * overlay.height);
  const Palette palette = make_palette(overlay.rgba, 4);
  if (palette.entries.empty())
    return encode(overlay.width, overlay.height, PNG_FORMAT_RGBA, overlay.rgba, {}, 0);
  return encode(overlay.width, overlay.height, PNG_FORMAT_RGBA_COLORMAP, palette.indices, palette.entries,
                palette.entries.size() / 4);
}

Result<void> write_png(const std::filesystem::path& file, const Image& image) {
  const std::vector<std::uint8_t> bytes = encode_png(image);
  return write_file(file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace palpate
