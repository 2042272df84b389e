#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <span>

#include "volume_io/label_text.h"
#include "volume_io/mesh.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

constexpr std::string_view kBlank = " \t\r\n";
// maximum size of one array: the points of the maximum number of triangles
constexpr std::uint64_t kMaxNumbers = 9 * kMaxTriangles;

// ---- shared by both formats -------------------------------------------------------------------------------

struct VtkType {
  std::size_t bytes = 0;
  bool is_float = false, is_signed = true;
};

// type names of the legacy and of the XML format
std::optional<VtkType> vtk_type(std::string_view name) {
  const std::string word = lower_case(name);
  struct Named {
    std::string_view word;
    VtkType type;
  };
  constexpr Named kTypes[] = {{"float", {4, true, true}},         {"double", {8, true, true}},
                              {"float32", {4, true, true}},       {"float64", {8, true, true}},
                              {"char", {1, false, true}},         {"unsigned_char", {1, false, false}},
                              {"int8", {1, false, true}},         {"uint8", {1, false, false}},
                              {"short", {2, false, true}},        {"unsigned_short", {2, false, false}},
                              {"int16", {2, false, true}},        {"uint16", {2, false, false}},
                              {"int", {4, false, true}},          {"unsigned_int", {4, false, false}},
                              {"int32", {4, false, true}},        {"uint32", {4, false, false}},
                              {"long", {8, false, true}},         {"unsigned_long", {8, false, false}},
                              {"vtkidtype", {4, false, true}},    {"vtktypeint64", {8, false, true}},
                              {"int64", {8, false, true}},        {"uint64", {8, false, false}},
                              {"vtktypeint32", {4, false, true}}, {"vtktypeint8", {1, false, true}},
                              {"string", {1, false, false}}};
  for (const Named& named : kTypes)
    if (named.word == word) return named.type;
  return std::nullopt;
}

// value of a number of at most 8 bytes
double vtk_value(const char* bytes, VtkType type, bool big_endian) {
  std::array<unsigned char, 8> raw{};
  std::memcpy(raw.data(), bytes, type.bytes);
  if (big_endian) std::reverse(raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(type.bytes));
  std::uint64_t bits = 0;
  for (std::size_t n = type.bytes; n-- > 0;) bits = bits << 8 | raw[n];
  if (type.is_float)
    return type.bytes == 4 ? static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(bits)))
                           : std::bit_cast<double>(bits);
  if (!type.is_signed) return static_cast<double>(bits);
  const std::size_t unused = 8 * (8 - type.bytes);
  return static_cast<double>(static_cast<std::int64_t>(bits << unused) >> unused);
}

// a value as an index; -1 if it is invalid
std::int64_t as_index(double value) {
  return value >= 0 && value < 1e15 ? static_cast<std::int64_t>(value) : -1;
}

bool add_points(MeshBuilder& builder, const std::vector<double>& values) {
  for (std::size_t n = 0; n + 2 < values.size(); n += 3)
    builder.add_point({values[n], values[n + 1], values[n + 2]});
  return values.size() % 3 == 0;
}

enum class Cells { kPolygons, kStrips };

// adds a polygon or strip, given its corners
bool add_cell(MeshBuilder& builder, Cells cells, std::span<const double> corners, std::int64_t first_point) {
  std::vector<std::int64_t> indices;
  for (const double corner : corners) {
    const std::int64_t index = as_index(corner);
    if (index < 0) return false;
    indices.push_back(first_point + index);
  }
  if (cells == Cells::kPolygons) return builder.add_polygon(indices);
  for (std::size_t n = 2; n < indices.size(); ++n) {
    // every second triangle of a strip has the opposite orientation
    const bool odd = n % 2 == 1;
    if (!builder.add_triangle(indices[n - 2 + odd], indices[n - 1 - odd], indices[n])) return false;
  }
  return true;
}

// @param offsets  end of each cell in `corners`
bool add_cells(MeshBuilder& builder, Cells cells, const std::vector<double>& offsets,
               const std::vector<double>& corners, std::int64_t first_point) {
  std::int64_t begin = 0;
  for (const double offset : offsets) {
    const std::int64_t end = as_index(offset);
    if (end < begin || end > static_cast<std::int64_t>(corners.size())) return false;
    if (!add_cell(builder, cells,
                  std::span(corners).subspan(static_cast<std::size_t>(begin),
                                             static_cast<std::size_t>(end - begin)),
                  first_point))
      return false;
    begin = end;
  }
  return true;
}

// ---- legacy -------------------------------------------------------------------------------------------

// tokenizer for the sections of a legacy file
class LegacyReader {
 public:
  explicit LegacyReader(std::string_view bytes) : bytes_(bytes) {}

  std::string_view line() { return read_line(bytes_); }
  bool binary = false;
  bool too_many = false;  // an array exceeded kMaxNumbers
  bool at_end() const { return bytes_.empty(); }

  // next word, across line ends
  std::string_view word() {
    const auto begin = bytes_.find_first_not_of(kBlank);
    if (begin == std::string_view::npos) {
      bytes_ = {};
      return {};
    }
    const auto end = std::min(bytes_.find_first_of(kBlank, begin), bytes_.size());
    const std::string_view found = bytes_.substr(begin, end - begin);
    bytes_.remove_prefix(end);
    return found;
  }
  std::optional<std::uint64_t> count() { return parse_number<std::uint64_t>(word()); }

  // reads an array of `count` numbers; binary ones begin on the next line
  bool numbers(VtkType type, std::uint64_t count, std::vector<double>& values) {
    values.clear();
    if (binary) {
      line();
      if (count > bytes_.size() / type.bytes) return false;
      if ((too_many = count > kMaxNumbers)) return false;
      values.reserve(count);
      for (std::uint64_t n = 0; n < count; ++n)
        values.push_back(vtk_value(bytes_.data() + n * type.bytes, type, true));
      bytes_.remove_prefix(count * type.bytes);
      return true;
    }
    if (count > bytes_.size()) return false;
    if ((too_many = count > kMaxNumbers)) return false;
    for (std::uint64_t n = 0; n < count; ++n) {
      const auto value = mesh_number(word());
      if (!value) return false;
      values.push_back(*value);
    }
    return true;
  }
  // skips strings of a field: one per line, or preceded by their lengths
  bool skip_texts(std::uint64_t count) {
    line();
    for (std::uint64_t n = 0; n < count; ++n) {
      if (bytes_.empty()) return false;
      if (!binary) {
        line();
        continue;
      }
      const auto lead = static_cast<unsigned char>(bytes_[0]);
      constexpr std::size_t kLengthBytes[] = {8, 4, 2, 1};
      const std::size_t length_bytes = kLengthBytes[lead >> 6];
      if (bytes_.size() < length_bytes) return false;
      std::uint64_t length = lead & 0x3F;
      for (std::size_t b = 1; b < length_bytes; ++b)
        length = length << 8 | static_cast<unsigned char>(bytes_[b]);
      bytes_.remove_prefix(length_bytes);
      if (length > bytes_.size()) return false;
      bytes_.remove_prefix(length);
    }
    return true;
  }
  // skips to the empty line that ends an array's metadata
  void skip_metadata() {
    line();
    while (!bytes_.empty() && !trimmed(line()).empty()) {
    }
  }

 private:
  std::string_view bytes_;
};

bool read_legacy_field(LegacyReader& in) {
  in.word();  // field name
  const auto arrays = in.count();
  if (!arrays) return false;
  std::vector<double> values;
  for (std::uint64_t n = 0; n < *arrays; ++n) {
    if (in.at_end()) return false;
    std::string_view name = in.word();
    while (name == "METADATA") {
      in.skip_metadata();
      name = in.word();
    }
    const auto components = in.count(), tuples = in.count();
    const std::string_view type_name = in.word();
    const auto type = vtk_type(type_name);
    constexpr std::uint64_t kMaxComponents = 1 << 16;
    if (!components || !tuples || !type || *components > kMaxComponents ||
        *tuples > std::numeric_limits<std::uint64_t>::max() / kMaxComponents)
      return false;
    const std::uint64_t count = *components * *tuples;
    if (lower_case(type_name) == "string" ? !in.skip_texts(count) : !in.numbers(*type, count, values))
      return false;
  }
  return true;
}

// from version 5.1 on, the offset of each cell and the end of the last; before, each cell is preceded by its
// number of corners
bool read_legacy_cells(LegacyReader& in, MeshBuilder& builder, Cells cells, bool in_two_arrays) {
  const auto first = in.count(), second = in.count();
  if (!first || !second) return false;
  std::vector<double> offsets, corners;
  if (in_two_arrays) {
    if (*first == 0) return true;
    if (in.word() != "OFFSETS") return false;
    auto type = vtk_type(in.word());
    if (!type || !in.numbers(*type, *first, offsets)) return false;
    if (in.word() != "CONNECTIVITY") return false;
    type = vtk_type(in.word());
    if (!type || !in.numbers(*type, *second, corners)) return false;
    if (offsets.front() != 0) return false;
    offsets.erase(offsets.begin());
    return add_cells(builder, cells, offsets, corners, 0);
  }
  std::vector<double> values;
  if (!in.numbers({4, false, true}, *second, values)) return false;
  for (std::size_t at = 0; at < values.size();) {
    const std::int64_t count = as_index(values[at]);
    if (count < 0 || static_cast<std::uint64_t>(count) > values.size() - at - 1) return false;
    if (!add_cell(builder, cells, std::span(values).subspan(at + 1, static_cast<std::size_t>(count)), 0))
      return false;
    at += 1 + static_cast<std::size_t>(count);
  }
  return true;
}

// skips vertices and lines
bool skip_legacy_cells(LegacyReader& in, bool in_two_arrays) {
  const auto first = in.count(), second = in.count();
  if (!first || !second) return false;
  std::vector<double> values;
  if (!in_two_arrays) return in.numbers({4, false, true}, *second, values);
  if (*first == 0) return true;
  for (const std::uint64_t count : {*first, *second}) {
    in.word();
    const auto type = vtk_type(in.word());
    if (!type || !in.numbers(*type, count, values)) return false;
  }
  return true;
}

// ---- XML ----------------------------------------------------------------------------------------------

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

Result<MeshFile> parse_vtk_legacy(std::string_view bytes, MeshBuilder builder) {
  LegacyReader in(bytes);
  builder.begin("");
  const std::string_view version = in.line();
  const bool in_two_arrays = version.find("Version 5") != std::string_view::npos;
  builder.read_space(in.line());
  const std::string_view kind = in.word();
  if (kind != "ASCII" && kind != "BINARY") return builder.damaged("it is neither ASCII nor BINARY");
  in.binary = kind == "BINARY";
  bool polydata = false;
  while (!in.at_end()) {
    const std::string_view word = in.word();
    const std::string name(word);
    const auto damaged_at = [&] {
      return in.too_many ? builder.too_many()
                         : builder.damaged("its part " + name + " does not match its description");
    };
    if (word.empty()) break;
    if (word == "DATASET") {
      if (in.word() != "POLYDATA")
        return builder.refused("holds no POLYDATA and therefore no surface",
                               "export the surface of it as POLYDATA");
      polydata = true;
    } else if (word == "FIELD") {
      if (!read_legacy_field(in)) return damaged_at();
    } else if (word == "METADATA") {
      in.skip_metadata();
    } else if (!polydata) {
      return builder.damaged("it does not state its DATASET");
    } else if (word == "POINTS") {
      const auto count = in.count();
      const auto type = vtk_type(in.word());
      std::vector<double> values;
      if (!count || !type || *count > bytes.size() || !in.numbers(*type, 3 * *count, values) ||
          !add_points(builder, values))
        return damaged_at();
    } else if (word == "POLYGONS" || word == "TRIANGLE_STRIPS") {
      if (!read_legacy_cells(in, builder, word == "POLYGONS" ? Cells::kPolygons : Cells::kStrips,
                             in_two_arrays))
        return damaged_at();
    } else if (word == "VERTICES" || word == "LINES") {
      if (!skip_legacy_cells(in, in_two_arrays)) return damaged_at();
    } else if (word == "POINT_DATA" || word == "CELL_DATA") {
      // attributes of points and cells follow, up to the end
      break;
    } else {
      return builder.damaged("it has an unknown section");
    }
  }
  return builder.finish();
}

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
