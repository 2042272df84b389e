#include "volume_io/dicom/dicom_jpeg2000_header.h"

#include <algorithm>

namespace palpate::volume_io {
namespace {

// Big-endian numbers of a codestream; beyond its end they are 0 and over() is true.
class CodestreamBytes {
 public:
  explicit CodestreamBytes(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  bool over() const { return over_; }
  std::uint32_t number(std::size_t count) {
    std::uint32_t value = 0;
    for (std::size_t n = 0; n < count; ++n) value = value << 8 | byte();
    return value;
  }
  // contents of the next marker segment, after its length
  CodestreamBytes segment() {
    const std::uint32_t length = number(2);
    const std::size_t left = bytes_.size() - at_, inside = length < 2 ? left + 1 : length - 2;
    if (inside > left) over_ = true;
    CodestreamBytes part(bytes_.subspan(at_, std::min(inside, left)));
    at_ += std::min(inside, left);
    return part;
  }

 private:
  std::uint8_t byte() {
    if (at_ < bytes_.size()) return bytes_[at_++];
    over_ = true;
    return 0;
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  bool over_ = false;
};

enum Marker : std::uint32_t {
  kStart = 0xFF4F,
  kCapabilities = 0xFF50,
  kSize = 0xFF51,
  kCoding = 0xFF52,
  kTilePart = 0xFF90
};

// parses the SIZ segment; false if the sizes of image or tiles are invalid
bool read_size(CodestreamBytes segment, Jpeg2000Header& header) {
  constexpr std::uint32_t kHighThroughput = 1 << 14;
  header.high_throughput = (segment.number(2) & kHighThroughput) != 0;
  const std::uint32_t right = segment.number(4), bottom = segment.number(4), left = segment.number(4),
                      top = segment.number(4);
  const std::uint32_t tile_columns = segment.number(4), tile_rows = segment.number(4),
                      tiles_left = segment.number(4), tiles_top = segment.number(4);
  header.components = static_cast<int>(segment.number(2));
  for (int n = 0; n < header.components; ++n) {
    const std::uint32_t depth = segment.number(1), across = segment.number(1), down = segment.number(1);
    header.subsampled = header.subsampled || across != 1 || down != 1;
    if (n > 0) continue;
    header.bits = static_cast<int>(depth & 0x7F) + 1;
    header.is_signed = (depth & 0x80) != 0;
  }
  if (segment.over() || header.components == 0 || tile_columns == 0 || tile_rows == 0 || left >= right ||
      top >= bottom || tiles_left > left || tiles_top > top)
    return false;
  header.columns = right - left;
  header.rows = bottom - top;
  const auto count = [](std::uint64_t length, std::uint64_t tile) { return (length + tile - 1) / tile; };
  header.tiles = count(right - tiles_left, tile_columns) * count(bottom - tiles_top, tile_rows);
  return true;
}

void read_coding(CodestreamBytes segment, Jpeg2000Header& header) {
  // skips style, progression order, layers, component transform, decomposition levels, code block size and
  // style
  for (int passed = 0; passed < 8; ++passed) segment.number(1);
  constexpr std::uint32_t kHighThroughputBlocks = 0xC0;
  header.high_throughput = header.high_throughput || (segment.number(1) & kHighThroughputBlocks) != 0;
  header.irreversible = segment.number(1) == 0;
}

}  // namespace

std::optional<Jpeg2000Header> read_jpeg2000_header(std::span<const std::uint8_t> front) {
  CodestreamBytes bytes(front);
  Jpeg2000Header header;
  if (bytes.number(2) != kStart || bytes.number(2) != kSize || !read_size(bytes.segment(), header))
    return std::nullopt;
  bool coded = false;
  while (!bytes.over() && !coded) {
    const std::uint32_t marker = bytes.number(2);
    if (marker == kTilePart || marker < 0xFF00) return std::nullopt;
    const CodestreamBytes segment = bytes.segment();
    if (marker == kCapabilities) header.high_throughput = true;
    if (marker != kCoding) continue;
    read_coding(segment, header);
    coded = true;
  }
  if (bytes.over()) return std::nullopt;
  return header;
}

}  // namespace palpate::volume_io
