#include "volume_io/image/image.h"

#include <algorithm>
#include <array>
#include <cstring>

#include "volume_io/voxel_source.h"

namespace palpate::volume_io {

using namespace std::string_view_literals;

std::optional<ImageFormat> image_format_of(std::string_view front) {
  if (front.starts_with("\x89PNG\r\n\x1A\n"sv)) return ImageFormat::kPng;
  if (front.starts_with("\xFF\xD8\xFF"sv)) return ImageFormat::kJpeg;
  for (const std::string_view magic : {"II*\0"sv, "MM\0*"sv, "II+\0"sv, "MM\0+"sv})
    if (front.starts_with(magic)) return ImageFormat::kTiff;
  return std::nullopt;
}

ImageBytes bytes_in_memory(std::string_view bytes) {
  return {bytes.size(), [bytes](std::uint64_t offset, std::span<std::byte> into) {
            if (offset > bytes.size() || into.size() > bytes.size() - offset) return false;
            if (!into.empty()) std::memcpy(into.data(), bytes.data() + offset, into.size());
            return true;
          }};
}

Result<void> check_image_size(std::uint64_t columns, std::uint64_t rows) {
  constexpr std::uint64_t kMaxAlong = 1 << 20;
  if (columns == 0 || rows == 0) return bad_input("", "has a picture without pixels", kCopyImage);
  if (columns <= kMaxAlong && rows <= kMaxAlong && columns * rows <= kMaxImagePixels) return {};
  return bad_input("",
                   "has a picture of " + std::to_string(columns) + " x " + std::to_string(rows) +
                       " pixels, but " + std::to_string(kMaxImagePixels) + " are the maximum",
                   "crop or scale the pictures first, as in Fiji (Image > Scale)");
}

Result<std::unique_ptr<ImageDecoder>> open_image(ImageBytes bytes) {
  std::array<std::byte, 8> front{};
  const std::size_t count = std::min<std::uint64_t>(front.size(), bytes.size);
  std::optional<ImageFormat> format;
  if (bytes.read(0, std::span(front).first(count)))
    format = image_format_of({reinterpret_cast<const char*>(front.data()), count});
  if (!format) return bad_input("", "is not a supported picture", "give PNG, TIFF or JPEG");
  switch (*format) {
    case ImageFormat::kPng:
      return open_png(std::move(bytes));
    case ImageFormat::kJpeg:
      return open_jpeg(std::move(bytes));
    default:
      return open_tiff(std::move(bytes));
  }
}

}  // namespace palpate::volume_io
