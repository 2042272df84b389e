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

/// Slices as pictures: PNG, JPEG, and TIFF with its pages. Bytes become pixels; what they mean is decided by
/// whoever stacks them (image_stack.h). The bytes are untrusted, and libpng and libjpeg may be led astray by
/// them: for a process of its own.
namespace palpate::volume_io {

enum class ImageFormat { kPng, kJpeg, kTiff };

/// By the first bytes of a file.
std::optional<ImageFormat> image_format_of(std::string_view front);

/// Bytes of a file, which are read in any order.
struct ImageBytes {
  std::uint64_t size = 0;
  /// Fills `bytes` from an offset on; false: they are not all there.
  std::function<bool(std::uint64_t offset, std::span<std::byte> bytes)> read;
};
/// @param bytes  outlive what is returned
ImageBytes bytes_in_memory(std::string_view bytes);

struct ImageShape {
  int columns = 0, rows = 0;
  bool colour = false;                      ///< pixels are 0xRRGGBB, and 0 where they are transparent
  Component component = Component::kUint8;  ///< of grey values: uint8, uint16, or float32 by its bits
  bool operator==(const ImageShape&) const = default;
  std::size_t pixels() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
};

/// The most pixels of one picture, before memory is taken for them.
inline constexpr std::size_t kMostImagePixels = std::size_t{1} << 26;
/// The most bytes of a PNG or JPEG file, which are held at once.
inline constexpr std::uint64_t kMostImageBytes = std::uint64_t{1} << 29;

/// Decoder of one file.
class ImageDecoder {
 public:
  virtual ~ImageDecoder() = default;
  /// By the header of each page; one at least.
  const std::vector<ImageShape>& pages() const { return pages_; }
  /// Row by row from the top, `pages()[page].pixels()` of them. Errors, without `where`: cut short, damaged,
  /// packed in a way that is not read.
  virtual Result<void> read(std::size_t page, std::span<std::uint32_t> pixels) = 0;

 protected:
  std::vector<ImageShape> pages_;
};

/// Understands the headers, reads no pixel. Errors, without `where`: no picture, cut short, damaged, of a
/// kind that is not read, too large.
Result<std::unique_ptr<ImageDecoder>> open_image(ImageBytes bytes);
/// The same of one format.
Result<std::unique_ptr<ImageDecoder>> open_png(ImageBytes bytes);
Result<std::unique_ptr<ImageDecoder>> open_jpeg(ImageBytes bytes);
Result<std::unique_ptr<ImageDecoder>> open_tiff(ImageBytes bytes);

/// A refusal unless a picture has at least one pixel and at most kMostImagePixels.
Result<void> check_image_size(std::uint64_t columns, std::uint64_t rows);

inline constexpr const char* kDamagedImage = "is damaged or cut short";
inline constexpr const char* kCopyImage = "copy it again, or export it again as PNG or as uncompressed TIFF";

}  // namespace palpate::volume_io
