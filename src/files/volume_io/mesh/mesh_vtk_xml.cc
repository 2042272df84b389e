#include <zlib.h>

#include <algorithm>
#include <array>
#include <limits>
#include <span>

#include "volume_io/labels/label_text.h"
#include "volume_io/mesh/mesh.h"
#include "volume_io/mesh/vtk_values.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

// An XML tag, as far as VTK's files need it.
struct XmlTag {
  std::string_view name, attributes;
  bool closes = false, empty = false;

  std::string_view operator[](std::string_view attribute) const {
    for (std::size_t at = attributes.find(attribute); at != std::string_view::npos;
         at = attributes.find(attribute, at + 1)) {
      if (at > 0 && kBlank.find(attributes[at - 1]) == std::string_view::npos) continue;
      const auto after = attributes.find_first_not_of(kBlank, at + attribute.size());
      if (after == std::string_view::npos || attributes[after] != '=') continue;
      const auto open = attributes.find_first_not_of(kBlank, after + 1);
      if (open == std::string_view::npos || (attributes[open] != '"' && attributes[open] != '\'')) continue;
      const auto end = attributes.find(attributes[open], open + 1);
      // an unterminated value leaves no attributes after it
      if (end == std::string_view::npos) return {};
      return attributes.substr(open + 1, end - open - 1);
    }
    return {};
  }
};

class XmlReader {
 public:
  explicit XmlReader(std::string_view bytes) : bytes_(bytes) {}

  // next tag; nullopt at the end, or if it is truncated
  std::optional<XmlTag> tag() {
    while (true) {
      const auto begin = bytes_.find('<', at_);
      if (begin == std::string_view::npos) return std::nullopt;
      if (bytes_.substr(begin).starts_with("<!--")) {
        const auto end = bytes_.find("-->", begin);
        if (end == std::string_view::npos) return std::nullopt;
        at_ = end + 3;
        continue;
      }
      // a '>' in quotation marks does not end the tag
      std::size_t end = begin + 1;
      char quote = 0;
      for (; end < bytes_.size() && (quote != 0 || bytes_[end] != '>'); ++end) {
        if (quote != 0 && bytes_[end] == quote)
          quote = 0;
        else if (quote == 0 && (bytes_[end] == '"' || bytes_[end] == '\''))
          quote = bytes_[end];
      }
      if (end >= bytes_.size()) return std::nullopt;
      at_ = end + 1;
      std::string_view inside = bytes_.substr(begin + 1, end - begin - 1);
      if (inside.starts_with('?') || inside.starts_with('!')) continue;
      XmlTag tag;
      if ((tag.closes = inside.starts_with('/'))) inside.remove_prefix(1);
      if ((tag.empty = inside.ends_with('/'))) inside.remove_suffix(1);
      const auto name_end = std::min(inside.find_first_of(kBlank), inside.size());
      tag.name = inside.substr(0, name_end);
      tag.attributes = inside.substr(name_end);
      return tag;
    }
  }
  // text between the last tag and the next
  std::string_view text() const { return bytes_.substr(at_, bytes_.find('<', at_) - at_); }
  std::string_view remaining() const { return bytes_.substr(at_); }

 private:
  std::string_view bytes_;
  std::size_t at_ = 0;
};

// Raw bytes, or decoded base64, in which each part may have its own padding.
class ByteStream {
 public:
  ByteStream(std::string_view text, bool base64) : text_(text), base64_(base64) {}

  // reads `count` bytes; false if there are fewer
  bool read(std::size_t count, std::string& bytes) {
    bytes.clear();
    if (!base64_) {
      if (count > text_.size()) return false;
      bytes = std::string(text_.substr(0, count));
      text_.remove_prefix(count);
      return true;
    }
    if (count > text_.size() + decoded_.size()) return false;
    bytes.reserve(count);
    while (bytes.size() < count) {
      if (decoded_.empty() && !decode_four()) return false;
      bytes += decoded_.front();
      decoded_.erase(0, 1);
    }
    return true;
  }
  // discards the padding of the last group of four letters
  void end_part() { decoded_.clear(); }

 private:
  bool decode_four() {
    std::array<int, 4> values{};
    std::size_t padding = 0;
    for (int& value : values) {
      while (!text_.empty() && kBlank.find(text_[0]) != std::string_view::npos) text_.remove_prefix(1);
      if (text_.empty()) return false;
      const char letter = text_[0];
      text_.remove_prefix(1);
      if (letter == '=') {
        ++padding;
        value = 0;
        continue;
      }
      constexpr std::string_view kLetters =
          "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
      const auto at = kLetters.find(letter);
      if (at == std::string_view::npos || padding > 0) return false;
      value = static_cast<int>(at);
    }
    if (padding > 2) return false;
    const int bits = values[0] << 18 | values[1] << 12 | values[2] << 6 | values[3];
    for (std::size_t n = 0; n < 3 - padding; ++n) decoded_ += static_cast<char>(bits >> (16 - 8 * n));
    return true;
  }

  std::string_view text_;
  bool base64_;
  std::string decoded_;
};

struct XmlSettings {
  bool big_endian = false, wide_header = false;
  bool packed = false;  // compressed by zlib
};

// number of a data header
std::optional<std::uint64_t> header_number(ByteStream& in, const XmlSettings& settings) {
  std::string bytes;
  const VtkType type{settings.wide_header ? std::size_t{8} : std::size_t{4}, false, false};
  if (!in.read(type.bytes, bytes)) return std::nullopt;
  const double value = vtk_value(bytes.data(), type, settings.big_endian);
  constexpr double kMaxSize = 1e15;
  if (value > kMaxSize) return std::nullopt;
  return static_cast<std::uint64_t>(value);
}

// Bytes of an array: its size and contents, or blocks that are compressed individually.
// @param left  limit for all arrays together, because several may refer to the same bytes; reduced by the
//              size
std::optional<std::string> array_bytes(ByteStream in, const XmlSettings& settings, std::uint64_t& left) {
  const std::uint64_t largest = left;
  std::string bytes;
  const auto count = header_number(in, settings);
  if (!count) return std::nullopt;
  if (!settings.packed) {
    if (*count > largest || !in.read(*count, bytes)) return std::nullopt;
    left -= bytes.size();
    return bytes;
  }
  const auto block_bytes = header_number(in, settings), last_block_bytes = header_number(in, settings);
  if (!block_bytes || !last_block_bytes || (*block_bytes > 0 && *count > largest / *block_bytes + 1) ||
      *count > largest || *block_bytes > largest || *last_block_bytes > *block_bytes)
    return std::nullopt;
  std::vector<std::uint64_t> sizes;
  for (std::uint64_t n = 0; n < *count; ++n) {
    const auto size = header_number(in, settings);
    if (!size || *size > largest) return std::nullopt;
    sizes.push_back(*size);
  }
  in.end_part();
  std::string packed;
  for (std::uint64_t n = 0; n < *count; ++n) {
    if (!in.read(sizes[n], packed)) return std::nullopt;
    const bool partial = n + 1 == *count && *last_block_bytes > 0;
    const std::size_t expected = partial ? *last_block_bytes : *block_bytes;
    // zlib expands data at most 1032 times
    constexpr std::size_t kMaxGain = 1100, kLeast = 64;
    if (expected > kLeast + kMaxGain * packed.size() || bytes.size() + expected > largest)
      return std::nullopt;
    const std::size_t before = bytes.size();
    bytes.resize(before + expected);
    uLongf received = static_cast<uLongf>(expected);
    if (::uncompress(reinterpret_cast<Bytef*>(bytes.data() + before), &received,
                     reinterpret_cast<const Bytef*>(packed.data()),
                     static_cast<uLong>(packed.size())) != Z_OK ||
        received != expected)
      return std::nullopt;
  }
  left -= bytes.size();
  return bytes;
}

// a DataArray whose values have not been read yet
struct XmlArray {
  std::string section, name;  // "Points"; "connectivity"
  VtkType type;
  bool text = false;      // numbers as text
  bool appended = false;  // values are in the appended data; otherwise in `body`
  std::string_view body;
  std::uint64_t offset = 0;
  std::size_t piece = 0;
};

struct XmlFile {
  XmlSettings settings;
  std::vector<XmlArray> arrays;
  std::string_view appended;
  bool appended_base64 = false;
  std::size_t pieces = 0;
  std::uint64_t bytes_left = std::uint64_t{1} << 28;  // limit for all arrays
  bool too_many = false;                              // an array exceeded kMaxNumbers
};

std::optional<std::vector<double>> array_values(XmlFile& file, const XmlArray& array) {
  std::vector<double> values;
  if (array.text) {
    std::string_view text = array.body;
    while (true) {
      const auto begin = text.find_first_not_of(kBlank);
      if (begin == std::string_view::npos) return values;
      const auto end = std::min(text.find_first_of(kBlank, begin), text.size());
      const auto value = mesh_number(text.substr(begin, end - begin));
      if (!value || (file.too_many = values.size() == kMaxNumbers)) return std::nullopt;
      values.push_back(*value);
      text.remove_prefix(end);
    }
  }
  if (array.appended && array.offset > file.appended.size()) return std::nullopt;
  const std::string_view body =
      array.appended ? file.appended.substr(static_cast<std::size_t>(array.offset)) : array.body;
  const auto bytes =
      array_bytes(ByteStream(body, !array.appended || file.appended_base64), file.settings, file.bytes_left);
  if (!bytes || bytes->size() % array.type.bytes != 0 ||
      (file.too_many = bytes->size() / array.type.bytes > kMaxNumbers))
    return std::nullopt;
  values.reserve(bytes->size() / array.type.bytes);
  for (std::size_t at = 0; at < bytes->size(); at += array.type.bytes)
    values.push_back(vtk_value(bytes->data() + at, array.type, file.settings.big_endian));
  return values;
}

// parses the tags; errors have no source
Result<XmlFile> read_xml(std::string_view bytes, MeshBuilder& builder) {
  XmlFile file;
  XmlReader in(bytes);
  std::string section;
  bool began = false, ended = false;
  while (const auto tag = in.tag()) {
    if (tag->name == "VTKFile") {
      if (tag->closes) {
        ended = true;
        break;
      }
      began = true;
      if ((*tag)["type"] != "PolyData") return builder.damaged("it holds no PolyData");
      file.settings.big_endian = (*tag)["byte_order"] == "BigEndian";
      file.settings.wide_header = (*tag)["header_type"] == "UInt64";
      const std::string_view compressor = (*tag)["compressor"];
      file.settings.packed = !compressor.empty();
      if (file.settings.packed && compressor != "vtkZLibDataCompressor")
        return builder.refused("is compressed by " + std::string(compressor) + ", which is not supported",
                               "write it with zlib, or uncompressed");
    } else if (!began) {
      return builder.damaged("it does not start like a VTK file");
    } else if (tag->name == "Piece") {
      file.pieces += !tag->closes;
    } else if (tag->name == "AppendedData") {
      file.appended_base64 = (*tag)["encoding"] != "raw";
      const auto mark = in.remaining().find('_');
      if (mark == std::string_view::npos) return builder.damaged("its appended data do not begin");
      file.appended = in.remaining().substr(mark + 1);
      // appended data end the file, and may look like tags
      const auto end = file.appended.rfind("</AppendedData>");
      if (end == std::string_view::npos) return builder.damaged("its appended data do not end");
      file.appended = file.appended.substr(0, end);
      ended = true;
      break;
    } else if (tag->name == "DataArray" || tag->name == "Array") {
      if (tag->closes) continue;
      const auto type = vtk_type((*tag)["type"]);
      const std::string_view format = (*tag)["format"];
      const bool requested =
          section == "Points" || section == "Polys" || section == "Strips" || section == "FieldData";
      if (!requested) continue;
      if (!type) return builder.damaged("it has an array of unknown type");
      XmlArray array{section,
                     std::string((*tag)["Name"]),
                     *type,
                     format == "ascii",
                     format == "appended",
                     in.text(),
                     0,
                     file.pieces};
      if (tag->empty) array.body = {};
      if (array.appended) {
        const auto offset = parse_number<std::uint64_t>((*tag)["offset"]);
        if (!offset) return builder.damaged("it has an array without an offset");
        array.offset = *offset;
      }
      file.arrays.push_back(std::move(array));
    } else if (!tag->empty && tag->name != "InformationKey" && tag->name != "Value") {
      section = tag->closes ? "" : std::string(tag->name);
    }
  }
  if (!ended) return builder.damaged("it ends before its last tag");
  return file;
}

}  // namespace

Result<MeshFile> parse_vtk_xml(std::string_view bytes, MeshBuilder builder) {
  builder.begin("");
  auto file = read_xml(bytes, builder);
  if (!file) return file.error();
  constexpr std::size_t kMaxParts = 4096;
  if (file->pieces > kMaxParts || file->arrays.size() > kMaxParts)
    return builder.damaged("it has too many pieces");
  for (std::size_t piece = 0; piece <= file->pieces; ++piece) {
    const auto find = [&](std::string_view section, std::string_view name) -> const XmlArray* {
      const auto found = std::ranges::find_if(file->arrays, [&](const XmlArray& array) {
        return array.piece == piece && array.section == section && (name.empty() || array.name == name);
      });
      return found == file->arrays.end() ? nullptr : &*found;
    };
    const auto damaged_array = [&](const XmlArray& array) {
      return file->too_many ? builder.too_many()
                            : builder.damaged("the data of its array '" + array.section +
                                              "' do not match their description");
    };
    if (const XmlArray* space = find("FieldData", "SPACE")) {
      // characters as numbers
      const auto letters = array_values(*file, *space);
      if (!letters) return damaged_array(*space);
      std::string text = "SPACE=";
      for (const double letter : *letters)
        if (letter > 0 && letter < 128) text += static_cast<char>(letter);
      builder.read_space(text);
    }
    const XmlArray* points = find("Points", "");
    if (!points) continue;
    const auto first_point = static_cast<std::int64_t>(builder.points());
    const auto values = array_values(*file, *points);
    if (!values || !add_points(builder, *values)) return damaged_array(*points);
    for (const auto& [section, cells] :
         {std::pair{"Polys", Cells::kPolygons}, std::pair{"Strips", Cells::kStrips}}) {
      const XmlArray *offsets = find(section, "offsets"), *connectivity = find(section, "connectivity");
      if (!offsets || !connectivity) continue;
      const auto ends = array_values(*file, *offsets), corners = array_values(*file, *connectivity);
      if (!ends) return damaged_array(*offsets);
      if (!corners) return damaged_array(*connectivity);
      if (!add_cells(builder, cells, *ends, *corners, first_point)) return damaged_array(*connectivity);
    }
  }
  return builder.finish();
}

}  // namespace palpate::volume_io
