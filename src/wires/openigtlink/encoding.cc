#include "palpate/openigtlink/encoding.h"

#include <algorithm>
#include <bit>
#include <string>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/openigtlink/messages.h"

namespace palpate::igtl {
namespace {

constexpr std::size_t kMaxString_bytes = 0xffff;

class Writer {
 public:
  void put_uint(std::size_t bytes, std::uint64_t value) {
    for (std::size_t n = bytes; n-- > 0;) out_.push_back(static_cast<std::uint8_t>(value >> (8 * n)));
  }
  void real32(double value) { put_uint(4, std::bit_cast<std::uint32_t>(static_cast<float>(value))); }
  void reals32(const Eigen::Ref<const Eigen::Matrix3Xd>& columns) {
    for (Eigen::Index c = 0; c < columns.cols(); ++c)
      for (Eigen::Index r = 0; r < 3; ++r) real32(columns(r, c));
  }
  /// Zero-padded field; the field of a name ends with a zero, except that of a header, which may
  /// fill its field.
  void text(std::string_view text, std::size_t bytes) {
    for (std::size_t n = 0; n < bytes; ++n)
      out_.push_back(n < text.size() ? static_cast<std::uint8_t>(text[n]) : std::uint8_t{0});
  }
  void dims(const std::array<std::uint16_t, 3>& dims) {
    for (const std::uint16_t dim : dims) put_uint(2, dim);
  }
  void bytes(std::span<const std::uint8_t> bytes) { out_.insert(out_.end(), bytes.begin(), bytes.end()); }
  void reserve(std::size_t bytes) { out_.reserve(bytes); }
  MessageBytes take() { return std::move(out_); }

 private:
  MessageBytes out_;
};

// the longest part of a UTF-8 text that fits, without a torn character
std::string_view fitted(std::string_view text, std::size_t max_bytes) {
  if (text.size() <= max_bytes) return text;
  while (max_bytes > 0 && (static_cast<unsigned char>(text[max_bytes]) & 0xc0) == 0x80) --max_bytes;
  return text.substr(0, max_bytes);
}

MessageBytes message(std::string_view type, const Title& title, unsigned version, Writer content) {
  const MessageBytes body = content.take();
  Writer out;
  out.reserve(kHeader_bytes + body.size());
  out.put_uint(2, version);
  out.text(type, kType_bytes);
  out.text(fitted(title.name, kName_bytes), kName_bytes);
  out.put_uint(8, title.stamp);
  out.put_uint(8, body.size());
  out.put_uint(8, crc64(body));
  out.bytes(body);
  return out.take();
}

void put_status(Writer& out, StatusCode code, std::string_view text) {
  constexpr std::size_t kSubcode_bytes = 8, kErrorName_bytes = 20;
  out.put_uint(2, static_cast<std::uint16_t>(code));
  out.put_uint(kSubcode_bytes, 0);
  out.text("", kErrorName_bytes);
  out.text(text, text.size() + 1);
}

}  // namespace

MessageBytes transform_message(const Title& title, const Eigen::Matrix3d& rotation,
                               const Eigen::Vector3d& translation) {
  Writer out;
  out.reals32(rotation);
  out.reals32(translation);
  return message("TRANSFORM", title, 1, std::move(out));
}

MessageBytes string_message(const Title& title, std::string_view text) {
  constexpr std::uint16_t kUtf8 = 106;  // MIBenum of IANA's character sets
  text = fitted(text, kMaxString_bytes);
  Writer out;
  out.put_uint(2, kUtf8);
  out.put_uint(2, text.size());
  out.text(text, text.size());
  return message("STRING", title, 1, std::move(out));
}

MessageBytes line_message(const Title& title, const Eigen::Vector3d& from_mm, const Eigen::Vector3d& to_mm) {
  constexpr std::uint64_t kCellEntry_bytes = 4;
  Writer out;
  out.put_uint(4, 2);                      // points
  out.put_uint(4, 0), out.put_uint(4, 0);  // vertices: number, bytes
  out.put_uint(4, 1);                      // lines
  out.put_uint(4, 3 * kCellEntry_bytes);   // their bytes: a count and two indices
  out.put_uint(4, 0), out.put_uint(4, 0);  // polygons
  out.put_uint(4, 0), out.put_uint(4, 0);  // triangle strips
  out.put_uint(4, 0);                      // attributes
  out.reals32(from_mm);
  out.reals32(to_mm);
  for (const std::uint64_t entry : {2, 0, 1}) out.put_uint(kCellEntry_bytes, entry);
  return message("POLYDATA", title, 1, std::move(out));
}

MessageBytes status_message(const Title& title, StatusCode code, std::string_view text) {
  Writer out;
  put_status(out, code, text);
  return message("STATUS", title, 1, std::move(out));
}

MessageBytes image_message(const Title& title, const ImageGrid& grid, VoxelType type,
                           std::span<const std::uint8_t> voxels) {
  return image_message(title, grid, {{0, 0, 0}, grid.dims}, type, voxels);
}

MessageBytes image_message(const Title& title, const ImageGrid& grid, const SubVolume& part, VoxelType type,
                           std::span<const std::uint8_t> voxels) {
  constexpr std::uint64_t kVersion = 1, kComponents = 1, kLittleEndian = 2, kRas = 1;
  const std::size_t voxel_bytes = type == VoxelType::kUint16 ? 2 : 4;
  PALPATE_CHECK(voxels.size() == voxel_bytes * part.dims[0] * part.dims[1] * part.dims[2]);
  Eigen::Vector3d centre;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    PALPATE_CHECK(part.first[axis] + part.dims[axis] <= grid.dims[axis]);
    centre[static_cast<int>(axis)] = 0.5 * (grid.dims[axis] - 1);
  }
  Writer out;
  out.reserve(72 + voxels.size());
  out.put_uint(2, kVersion);
  out.put_uint(1, kComponents);
  out.put_uint(1, static_cast<std::uint8_t>(type));
  out.put_uint(1, kLittleEndian);
  out.put_uint(1, kRas);
  out.dims(grid.dims);
  out.reals32(grid.steps_mm);
  out.reals32(grid.first_mm + grid.steps_mm * centre);
  out.dims(part.first);
  out.dims(part.dims);
  out.bytes(voxels);
  return message("IMAGE", title, 1, std::move(out));
}

MessageBytes label_list_message(const Title& title, std::span<const ListedLabel> labels) {
  Writer out;
  for (const ListedLabel& label : labels) {
    out.text(fitted(label.name, 63), 64);
    out.text(fitted(label.image, kName_bytes), kName_bytes);
    out.put_uint(1, label.value);
    out.put_uint(1, 0);
    out.bytes(label.rgba);
    out.dims(label.dims);
    out.text("", kName_bytes);  // image that the labels were drawn on: none
  }
  return message("LBMETA", title, 1, std::move(out));
}

MessageBytes image_list_message(const Title& title, std::span<const ListedImage> images) {
  Writer out;
  for (const ListedImage& image : images) {
    out.text(fitted(image.name, 63), 64);
    out.text(fitted(image.name, kName_bytes), kName_bytes);
    out.text(fitted(image.modality, 31), 32);
    out.text("", 64);    // patient's name
    out.text("", 64);    // patient's identifier
    out.put_uint(8, 0);  // time of acquisition
    out.dims(image.dims);
    out.put_uint(1, static_cast<std::uint8_t>(image.type));
    out.put_uint(1, 0);
  }
  return message("IMGMETA", title, 1, std::move(out));
}

MessageBytes greeting() {
  constexpr std::uint64_t kExtendedHeader_bytes = 12, kMetadataHeader_bytes = 2;
  Writer out;
  out.put_uint(2, kExtendedHeader_bytes);
  out.put_uint(2, kMetadataHeader_bytes);
  out.put_uint(4, 0);  // metadata
  out.put_uint(4, 0);  // message number
  put_status(out, StatusCode::kOk, "");
  out.put_uint(kMetadataHeader_bytes, 0);
  return message("STATUS", {"palpate"}, 2, std::move(out));
}

}  // namespace palpate::igtl
