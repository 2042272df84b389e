#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "volume_io/component.h"

/// Decoders of slice images: PNG, JPEG, and multi-page TIFF. They convert bytes to pixels; the meaning of the
/// pixels is decided by image_stack.h. The bytes are untrusted and may compromise libpng and libjpeg: call
/// them in a reader process.
namespace palpate::volume_io {

enum class ImageFormat { kPng, kJpeg, kTiff };

/// Format by the first bytes of a file.
std::optional<ImageFormat> image_format_of(std::string_view front);

/// Random access to the bytes of a file.
struct ImageBytes {
  std::uint64_t size = 0;
  /// Fills `bytes` from an offset on; returns false if they are not all available.
  std::function<bool(std::uint64_t offset, std::span<std::byte> bytes)> read;
};
/// @param bytes  must outlive the returned object
ImageBytes bytes_in_memory(std::string_view bytes);

struct ImageShape {
  int columns = 0, rows = 0;
  bool colour = false;                      ///< Pixels are 0xRRGGBB, and 0 where fully transparent.
  Component component = Component::kUint8;  ///< Type of grey values: uint8, uint16, or float32 by its bits.
  bool operator==(const ImageShape&) const = default;
  std::size_t pixels() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
};

/// Maximum number of pixels of an image, checked before memory is allocated.
inline constexpr std::size_t kMaxImagePixels = std::size_t{1} << 26;
/// Maximum size of a PNG or JPEG file, which is held in memory; bytes.
inline constexpr std::uint64_t kMaxImageBytes = std::uint64_t{1} << 29;

/// Decoder of one file, with one or more pages.
class ImageDecoder {
 public:
  virtual ~ImageDecoder() = default;
  /// Size and type of each page, from its header; at least one.
  const std::vector<ImageShape>& pages() const { return pages_; }
  /// Decodes a page, row by row from the top.
  /// @param pixels  pages()[page].pixels() values
  /// Errors, without `where`: truncated; damaged; unsupported compression.
  virtual Result<void> read(std::size_t page, std::span<std::uint32_t> pixels) = 0;

 protected:
  std::vector<ImageShape> pages_;
};

/// Parses the headers without decoding pixels. Errors, without `where`: not an image; truncated; damaged;
/// unsupported; too large.
Result<std::unique_ptr<ImageDecoder>> open_image(ImageBytes bytes);
/// Opens an image of a known format, as open_image().
Result<std::unique_ptr<ImageDecoder>> open_png(ImageBytes bytes);
Result<std::unique_ptr<ImageDecoder>> open_jpeg(ImageBytes bytes);
Result<std::unique_ptr<ImageDecoder>> open_tiff(ImageBytes bytes);

/// Rejects an image without a pixel or with more than kMaxImagePixels.
Result<void> check_image_size(std::uint64_t columns, std::uint64_t rows);

inline constexpr const char* kDamagedImage = "is damaged or cut short";
inline constexpr const char* kCopyImage = "copy it again, or export it again as PNG or as uncompressed TIFF";

}  // namespace palpate::volume_io
