#include <algorithm>
#include <cmath>
#include <map>

#include "volume_io/formats/headers.h"
#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

using MetaFields = std::map<std::string, std::string>;

// lines up to ElementDataFile, which is the last one
Result<std::pair<MetaFields, std::size_t>> split_fields(std::string_view bytes, const std::string& source) {
  constexpr std::size_t kMaxName = 100, kMaxLine = 4000;
  MetaFields fields;
  std::string_view remaining = bytes;
  for (int number = 1; !remaining.empty(); ++number) {
    const std::string_view line = read_line(remaining);
    if (trimmed(line).empty()) continue;
    const auto equals = line.find('=');
    const std::string where = source + ":" + std::to_string(number);
    if (equals == std::string_view::npos || equals > kMaxName || line.size() > kMaxLine)
      return bad_input(where, "is not a line of a MetaImage header",
                       "is the file complete and really a MetaImage?");
    const std::string name(trimmed(line.substr(0, equals)));
    if (!fields.emplace(name, std::string(trimmed(line.substr(equals + 1)))).second)
      return bad_input(where, "repeats a field of its header");
    if (name == "ElementDataFile") return std::pair(fields, bytes.size() - remaining.size());
  }
  return bad_input(source, "its header does not state where the voxels are (ElementDataFile)",
                   "is the file complete?");
}

std::optional<Component> parse_element_type(const std::string& name) {
  static const std::map<std::string, Component> kTypes{
      {"MET_CHAR", Component::kInt8},       {"MET_UCHAR", Component::kUint8},
      {"MET_SHORT", Component::kInt16},     {"MET_USHORT", Component::kUint16},
      {"MET_INT", Component::kInt32},       {"MET_UINT", Component::kUint32},
      {"MET_LONG_LONG", Component::kInt64}, {"MET_ULONG_LONG", Component::kUint64},
      {"MET_FLOAT", Component::kFloat32},   {"MET_DOUBLE", Component::kFloat64}};
  const auto found = kTypes.find(name);
  return found == kTypes.end() ? std::nullopt : std::optional(found->second);
}

const std::string* field(const MetaFields& fields, std::initializer_list<const char*> names) {
  for (const char* name : names)
    if (const auto found = fields.find(name); found != fields.end()) return &found->second;
  return nullptr;
}

bool is_true(const std::string* text) {
  return text != nullptr && !text->empty() &&
         (text->front() == 'T' || text->front() == 't' || text->front() == '1');
}

// nullopt unless there are exactly `count` finite numbers
std::optional<std::vector<double>> parse_numbers(const std::string& text, std::size_t count) {
  std::vector<double> numbers;
  for (const std::string_view part : split_spaces(text)) {
    const auto number = parse_number<double>(part);
    if (!number || !std::isfinite(*number)) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers.size() == count ? std::optional(numbers) : std::nullopt;
}

Result<std::vector<std::int64_t>> parse_axes(const MetaFields& fields, const std::string& source) {
  const std::string* object = field(fields, {"ObjectType"});
  if (object != nullptr && *object != "Image")
    return bad_input(source, "holds another MetaIO object instead of an image");
  const std::string* dimensions = field(fields, {"NDims"});
  const std::string* sizes = field(fields, {"DimSize"});
  if (dimensions == nullptr || sizes == nullptr)
    return bad_input(source, "its header lacks NDims or DimSize");
  std::vector<std::int64_t> axes;
  for (const std::string_view part : split_spaces(*sizes)) {
    const auto size = parse_number<std::int64_t>(part);
    if (!size) return bad_input(source, "a size in its header is not a whole number");
    axes.push_back(*size);
  }
  const auto count = parse_number<std::uint32_t>(*dimensions);
  // MetaIO supports at most ten
  if (!count || *count != axes.size() || *count == 0 || *count > 10)
    return bad_input(source, "its NDims does not agree with its DimSize");
  return axes;
}

// Returns whether the header states directions.
Result<bool> read_meta_geometry(const MetaFields& fields, std::size_t axes, const std::string& source,
                                HeaderGeometry& geometry) {
  const std::size_t used = std::min<std::size_t>(3, axes);
  if (const std::string* text = field(fields, {"ElementSpacing", "ElementSize"})) {
    const auto spacing = parse_numbers(*text, axes);
    if (!spacing) return bad_input(source, "its spacing is not one finite number for each axis");
    for (const double s : *spacing)
      if (s <= 0) return bad_input(source, "its spacing is not positive");
    for (std::size_t a = 0; a < used; ++a) geometry.spacing_mm[static_cast<int>(a)] = (*spacing)[a];
  }
  const std::string* matrix = field(fields, {"TransformMatrix", "Rotation", "Orientation"});
  if (matrix != nullptr) {
    const auto numbers = parse_numbers(*matrix, axes * axes);
    if (!numbers)
      return bad_input(source,
                       "its TransformMatrix is not " + std::to_string(axes * axes) + " finite numbers");
    for (std::size_t a = 0; a < used; ++a)
      for (std::size_t r = 0; r < used; ++r)
        geometry.direction(static_cast<int>(r), static_cast<int>(a)) = (*numbers)[a * axes + r];
  }
  const std::string* origin = field(fields, {"Offset", "Position", "Origin"});
  if (origin != nullptr) {
    const auto numbers = parse_numbers(*origin, axes);
    if (!numbers) return bad_input(source, "its Offset is not one finite number for each axis");
    for (std::size_t a = 0; a < used; ++a) geometry.origin_mm[static_cast<int>(a)] = (*numbers)[a];
  }
  return matrix != nullptr && axes >= 3;
}

Result<void> read_voxel_fields(const MetaFields& fields, const std::string& source, MetaImageHeader& header) {
  const std::string* channels = field(fields, {"ElementNumberOfChannels"});
  if (channels != nullptr && parse_number<int>(*channels) != 1)
    return bad_input(source, "holds several values for each voxel", "extract one channel");
  const std::string* type = field(fields, {"ElementType"});
  if (type == nullptr) return bad_input(source, "its header lacks the ElementType");
  const auto component = parse_element_type(*type);
  if (!component)
    return bad_input(source, "its ElementType " + type->substr(0, 30) + " is not a supported number type",
                     "save it with another type, for example MET_SHORT");
  header.voxels.component = *component;
  header.voxels.big_endian = is_true(field(fields, {"ElementByteOrderMSB", "BinaryDataByteOrderMSB"}));
  const std::string* binary = field(fields, {"BinaryData"});
  if (is_true(field(fields, {"CompressedData"})))
    header.voxels.encoding = Encoding::kDeflate;
  else if (binary != nullptr && !is_true(binary))
    header.voxels.encoding = Encoding::kText;

  if (const std::string* text = field(fields, {"HeaderSize"})) {
    const auto size = parse_number<std::int64_t>(*text);
    if (!size || *size < -1 || *size > (std::int64_t{1} << 40))
      return bad_input(source, "its HeaderSize is not a number of bytes");
    if (*size == -1) header.voxels.trailing_bytes = 0;
    if (*size > 0) header.voxels.offset = static_cast<std::uint64_t>(*size);
  }
  return {};
}

}  // namespace

Result<MetaImageHeader> parse_metaimage_header(std::string_view bytes, const std::string& source) {
  const auto lines = split_fields(bytes, source);
  if (!lines) return lines.error();
  const auto& [fields, end] = *lines;
  auto axes = parse_axes(fields, source);
  if (!axes) return axes.error();

  MetaImageHeader header;
  const auto has_geometry = read_meta_geometry(fields, axes->size(), source, header.geometry);
  if (!has_geometry) return has_geometry.error();
  header.axes = std::move(*axes);
  header.has_geometry = *has_geometry;
  if (auto read = read_voxel_fields(fields, source, header); !read) return read.error();
  const std::string& data = fields.at("ElementDataFile");
  if (data == "LOCAL" || data == "Local" || data == "local") {
    header.voxels.offset += end;
  } else if (data.substr(0, 4) == "LIST" || data.find('%') != std::string::npos) {
    return bad_input(source, "its voxels are spread over several files", "save it as one file");
  } else if (data.empty()) {
    return bad_input(source, "names an empty data file");
  } else {
    header.data_file = data;
  }
  return header;
}

}  // namespace palpate::volume_io
