#include <bit>
#include <cmath>
#include <cstring>

#include "volume_io/headers.h"

namespace palpate::volume_io {
namespace {

// fields by their place in the header, in the byte order of the file
class Bytes {
 public:
  Bytes(std::string_view bytes, bool swap) : bytes_(bytes), swap_(swap) {}

  template <class T>
  T at(std::size_t offset) const {
    char field[sizeof(T)];
    std::memcpy(field, bytes_.data() + offset, sizeof(T));
    if (swap_) std::reverse(field, field + sizeof(T));
    return std::bit_cast<T>(field);
  }

 private:
  std::string_view bytes_;
  bool swap_;
};

std::optional<Component> component_of(std::int16_t datatype) {
  switch (datatype) {
    case 2:
      return Component::kUint8;
    case 4:
      return Component::kInt16;
    case 8:
      return Component::kInt32;
    case 16:
      return Component::kFloat32;
    case 64:
      return Component::kFloat64;
    case 256:
      return Component::kInt8;
    case 512:
      return Component::kUint16;
    case 768:
      return Component::kUint32;
    case 1024:
      return Component::kInt64;
    case 1280:
      return Component::kUint64;
    default:
      return std::nullopt;
  }
}

// the header's byte order from its first field, which is its size
Result<bool> needs_swap(std::string_view bytes, const std::string& source) {
  if (bytes.size() < kNiftiHeaderBytes)
    return bad_input(source, "ends inside its header, after " + std::to_string(bytes.size()) + " bytes",
                     "the file is cut short: copy or download it again");
  for (const bool swap : {false, true}) {
    const auto size = Bytes(bytes, swap).at<std::int32_t>(0);
    if (size == static_cast<std::int32_t>(kNiftiHeaderBytes)) return swap;
    if (size == 540)
      return bad_input(source, "is a NIfTI-2 file", "convert it to NIfTI-1, for example with nibabel");
  }
  return bad_input(source, "is not a NIfTI file", "is its name right?");
}

Result<void> read_geometry(const Bytes& bytes, const std::string& source, NiftiHeader& header) {
  const auto qform_code = bytes.at<std::int16_t>(252), sform_code = bytes.at<std::int16_t>(254);
  header.has_geometry = qform_code > 0 || sform_code > 0;
  const int length_unit = bytes.at<char>(123) & 7;
  if (length_unit == 1 || length_unit == 3)
    return bad_input(source,
                     std::string("its lengths are in ") + (length_unit == 1 ? "metres" : "micrometres") +
                         ", only millimetres are read",
                     "convert it to millimetres");
  if (sform_code > 0) {
    header.sform.emplace();
    for (std::size_t n = 0; n < 12; ++n)
      (*header.sform)(static_cast<int>(n / 4), static_cast<int>(n % 4)) = bytes.at<float>(280 + 4 * n);
    if (!header.sform->allFinite())
      return bad_input(source, "its sform holds something that is not a number");
    return {};
  }
  // voxel sizes count only where no sform holds them
  for (std::size_t a = 0; a < std::min<std::size_t>(header.axes.size(), 3); ++a) {
    const float size = bytes.at<float>(80 + 4 * a);
    if (!std::isfinite(size) || size <= 0)
      return bad_input(source,
                       "its voxel size (pixdim) along axis " + std::to_string(a + 1) + " is not positive",
                       "set it from the scan it came from");
  }
  for (std::size_t n = 0; qform_code > 0 && n < 6; ++n)
    if (!std::isfinite(bytes.at<float>(256 + 4 * n)))
      return bad_input(source, "its qform holds something that is not a number");
  return {};
}

}  // namespace

Result<NiftiHeader> parse_nifti_header(std::string_view text, const std::string& source) {
  const auto swap = needs_swap(text, source);
  if (!swap) return swap.error();
  const Bytes bytes(text, *swap);
  const std::string_view magic = text.substr(344, 4);
  NiftiHeader header;
  header.separate = magic == std::string_view("ni1\0", 4);
  if (!header.separate && magic != std::string_view("n+1\0", 4))
    return bad_input(source, "is an Analyze 7.5 file, which does not say which side is left",
                     "convert the original images to NIfTI");

  const auto axes = bytes.at<std::int16_t>(40);
  if (axes < 1 || axes > 7)
    return bad_input(source, "has " + std::to_string(axes) + " axes, its header is damaged");
  for (int a = 1; a <= axes; ++a)
    header.axes.push_back(bytes.at<std::int16_t>(40 + 2 * static_cast<std::size_t>(a)));

  const auto datatype = bytes.at<std::int16_t>(70);
  const auto component = component_of(datatype);
  if (!component)
    return bad_input(source, "its voxels are not plain numbers (datatype " + std::to_string(datatype) + ")",
                     "colour, complex and 128-bit values are not read: convert it");
  header.voxels.component = *component;
  if (bytes.at<std::int16_t>(72) != static_cast<int>(8 * bytes_of(*component)))
    return bad_input(source, "its bits per voxel do not agree with its datatype");
  header.voxels.big_endian = (std::endian::native == std::endian::big) != *swap;
  header.voxels.may_have_more = true;

  // the standard asks for 352 or more when the voxels stand in the same file; some writers leave it 0
  const float offset = bytes.at<float>(108);
  if (!std::isfinite(offset) || offset < 0 || offset > 1e9f)
    return bad_input(source, "its vox_offset is damaged");
  header.voxels.skip = static_cast<std::uint64_t>(offset);
  if (!header.separate && header.voxels.skip < kNiftiHeaderBytes) header.voxels.skip = 352;

  // slope 0 means that the values stand as they are
  const float slope = bytes.at<float>(112), intercept = bytes.at<float>(116);
  if (std::isfinite(slope) && slope != 0) {
    header.voxels.slope = slope;
    if (std::isfinite(intercept)) header.voxels.intercept = intercept;
  }
  if (auto read = read_geometry(bytes, source, header); !read) return read.error();
  return header;
}

}  // namespace palpate::volume_io
