#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "volume_io/labels/label_text.h"
#include "volume_io/mesh/mesh.h"

namespace palpate::volume_io {
namespace {

// Longest line accepted, to limit the memory for its words: a face with the maximum number of corners is
// shorter.
constexpr std::size_t kMaxMeshLine = std::size_t{1} << 25;

// number of type T at the beginning of `bytes`
template <class T>
T number_at(std::string_view bytes, bool big_endian) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes.data(), sizeof(T));
  if (big_endian != (std::endian::native == std::endian::big)) std::ranges::reverse(raw);
  return std::bit_cast<T>(raw);
}

std::string at_line(std::size_t line, const std::string& what) {
  return "line " + std::to_string(line) + " " + what;
}

std::string truncation_text(std::uint64_t received, std::uint64_t promised, const std::string& what) {
  return "it ends after " + std::to_string(received) + " of " + std::to_string(promised) + " " + what;
}

// ---- STL ------------------------------------------------------------------------------------------------

constexpr std::size_t kStlHeader = 84, kStlTriangle = 50;

Result<MeshFile> parse_binary_stl(std::string_view bytes, MeshBuilder builder) {
  builder.begin("");
  builder.read_space(bytes.substr(0, 80));
  const auto promised = number_at<std::uint32_t>(bytes.substr(80, 4), false);
  const std::size_t stored = (bytes.size() - kStlHeader) / kStlTriangle;
  if (stored < promised) return builder.damaged(truncation_text(stored, promised, "triangles"));
  for (std::uint32_t n = 0; n < promised; ++n) {
    // a normal, three corners, two unused bytes
    const std::string_view triangle = bytes.substr(kStlHeader + kStlTriangle * n, kStlTriangle);
    for (std::size_t corner = 0; corner < 3; ++corner) {
      Eigen::Vector3d point;
      for (std::size_t a = 0; a < 3; ++a)
        point[static_cast<int>(a)] =
            static_cast<double>(number_at<float>(triangle.substr(12 + 12 * corner + 4 * a, 4), false));
      builder.add_point(point);
    }
    const auto last = static_cast<std::int64_t>(builder.points());
    if (!builder.add_triangle(last - 3, last - 2, last - 1)) return builder.damaged("its triangles");
  }
  return builder.finish();
}

Result<MeshFile> parse_ascii_stl(std::string_view bytes, MeshBuilder builder) {
  std::size_t line = 0, corners = 0;
  bool open = false;
  while (!bytes.empty()) {
    const std::string_view text = trimmed(read_line(bytes));
    ++line;
    if (text.size() > kMaxMeshLine) return builder.damaged(at_line(line, "does not end"));
    const auto words = split_spaces(text);
    if (words.empty()) continue;
    const std::string word = lower_case(words[0]);
    if (word == "solid") {
      builder.read_space(text);
      // some programs write a title instead of a name
      const std::string_view name = trimmed(text.substr(5));
      builder.begin(name.find("SPACE=") == std::string_view::npos ? name : "");
      open = true;
    } else if (word == "endsolid") {
      open = false;
    } else if (!open) {
      return builder.damaged(at_line(line, "is outside a solid"));
    } else if (word == "vertex") {
      if (words.size() != 4) return builder.damaged(at_line(line, "is not a vertex of three numbers"));
      Eigen::Vector3d point;
      for (int a = 0; a < 3; ++a) {
        const auto number = mesh_number(words[static_cast<std::size_t>(a) + 1]);
        if (!number) return builder.damaged(at_line(line, "is not a vertex of three numbers"));
        point[a] = *number;
      }
      builder.add_point(point);
      ++corners;
    } else if (word == "endloop" || word == "endfacet") {
      if (word == "endfacet") continue;
      if (corners != 3) return builder.damaged(at_line(line, "ends a facet that is not a triangle"));
      const auto last = static_cast<std::int64_t>(builder.points());
      if (!builder.add_triangle(last - 3, last - 2, last - 1)) return builder.damaged("its triangles");
      corners = 0;
    } else if (word != "facet" && word != "outer") {
      return builder.damaged(at_line(line, "is not an STL keyword"));
    }
  }
  if (open || corners != 0) return builder.damaged("it ends in the middle of a solid");
  return builder.finish();
}

// ---- PLY ------------------------------------------------------------------------------------------------

enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

std::optional<PlyType> ply_type(std::string_view name) {
  constexpr std::pair<std::string_view, PlyType> kTypes[] = {
      {"char", PlyType::kInt8},      {"int8", PlyType::kInt8},       {"uchar", PlyType::kUint8},
      {"uint8", PlyType::kUint8},    {"short", PlyType::kInt16},     {"int16", PlyType::kInt16},
      {"ushort", PlyType::kUint16},  {"uint16", PlyType::kUint16},   {"int", PlyType::kInt32},
      {"int32", PlyType::kInt32},    {"uint", PlyType::kUint32},     {"uint32", PlyType::kUint32},
      {"float", PlyType::kFloat32},  {"float32", PlyType::kFloat32}, {"double", PlyType::kFloat64},
      {"float64", PlyType::kFloat64}};
  for (const auto& [word, type] : kTypes)
    if (word == name) return type;
  return std::nullopt;
}

struct PlyProperty {
  std::string name;
  PlyType type{};
  std::optional<PlyType> count;  // type of the length, for a list
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

enum class PlyBytes { kAscii, kLittle, kBig };

// values of the body, in order
class PlyValues {
 public:
  PlyValues(std::string_view bytes, PlyBytes order) : bytes_(bytes), order_(order) {}

  std::optional<double> next(PlyType type) {
    if (order_ == PlyBytes::kAscii) return next_word();
    switch (type) {
      case PlyType::kInt8:
        return take<std::int8_t>();
      case PlyType::kUint8:
        return take<std::uint8_t>();
      case PlyType::kInt16:
        return take<std::int16_t>();
      case PlyType::kUint16:
        return take<std::uint16_t>();
      case PlyType::kInt32:
        return take<std::int32_t>();
      case PlyType::kUint32:
        return take<std::uint32_t>();
      case PlyType::kFloat32:
        return take<float>();
      case PlyType::kFloat64:
        return take<double>();
    }
    return std::nullopt;
  }
  std::size_t left() const { return bytes_.size(); }

 private:
  template <class T>
  std::optional<double> take() {
    if (bytes_.size() < sizeof(T)) return std::nullopt;
    const T value = number_at<T>(bytes_, order_ == PlyBytes::kBig);
    bytes_.remove_prefix(sizeof(T));
    return static_cast<double>(value);
  }
  std::optional<double> next_word() {
    constexpr std::string_view kSpace = " \t\r\n";
    const auto begin = bytes_.find_first_not_of(kSpace);
    if (begin == std::string_view::npos) return std::nullopt;
    const auto end = std::min(bytes_.find_first_of(kSpace, begin), bytes_.size());
    const auto number = mesh_number(bytes_.substr(begin, end - begin));
    bytes_.remove_prefix(end);
    return number;
  }
  std::string_view bytes_;
  PlyBytes order_;
};

struct PlyHeader {
  PlyBytes order = PlyBytes::kAscii;
  std::vector<PlyElement> elements;
};

// parses the header and removes it from `bytes`
Result<PlyHeader> parse_ply_header(std::string_view& bytes, MeshBuilder& builder) {
  PlyHeader header;
  bool has_format = false;
  std::size_t line = 0;
  constexpr std::size_t kMaxLines = 1000;
  while (!bytes.empty() && line < kMaxLines) {
    const std::string_view text = trimmed(read_line(bytes));
    ++line;
    if (text.size() > kMaxMeshLine) return builder.damaged(at_line(line, "does not end"));
    const auto words = split_spaces(text);
    if (line == 1 || words.empty()) continue;
    const auto wrong = [&] { return builder.damaged(at_line(line, "of its header is invalid")); };
    if (words[0] == "end_header") {
      if (!has_format) return builder.damaged("its header does not state its format");
      return header;
    }
    if (words[0] == "comment" || words[0] == "obj_info") {
      builder.read_space(text);
    } else if (words[0] == "format") {
      has_format = true;
      if (words.size() < 2) return wrong();
      if (words[1] == "ascii")
        header.order = PlyBytes::kAscii;
      else if (words[1] == "binary_little_endian")
        header.order = PlyBytes::kLittle;
      else if (words[1] == "binary_big_endian")
        header.order = PlyBytes::kBig;
      else
        return wrong();
    } else if (words[0] == "element") {
      const auto count = words.size() == 3 ? parse_number<std::uint64_t>(words[2]) : std::nullopt;
      if (!count) return wrong();
      header.elements.push_back({std::string(words[1]), *count, {}});
    } else if (words[0] == "property" && !header.elements.empty()) {
      PlyProperty property;
      const bool list = words.size() == 5 && words[1] == "list";
      if (!list && words.size() != 3) return wrong();
      const auto type = ply_type(words[list ? 3 : 1]);
      if (!type) return wrong();
      property.type = *type;
      property.name = std::string(words.back());
      if (list && !(property.count = ply_type(words[2]))) return wrong();
      header.elements.back().properties.push_back(std::move(property));
    } else {
      return wrong();
    }
  }
  return builder.damaged("its header does not end");
}

}  // namespace

Result<MeshFile> parse_stl(std::string_view bytes, MeshBuilder builder) {
  // a binary file may begin with "solid" too: its size decides
  const bool has_header = bytes.size() >= kStlHeader;
  const bool as_long_as_it_says =
      has_header && bytes.size() == kStlHeader + kStlTriangle * std::uint64_t{number_at<std::uint32_t>(
                                                                    bytes.substr(80, 4), false)};
  if (!as_long_as_it_says && lower_case(trimmed(bytes.substr(0, 80))).starts_with("solid"))
    return parse_ascii_stl(bytes, std::move(builder));
  if (!has_header) return builder.damaged("it ends in its header");
  return parse_binary_stl(bytes, std::move(builder));
}

Result<MeshFile> parse_obj(std::string_view bytes, MeshBuilder builder) {
  // vertices are numbered across the file: each object gets those that it uses
  std::vector<Eigen::Vector3d> points;
  std::vector<std::uint32_t> index_in_mesh;  // index + 1 in the current object; 0: not used
  std::vector<bool> consumed;                // used by some object
  std::vector<std::size_t> used;
  std::vector<std::int64_t> corners;
  bool objects = false, groups_share_points = false;
  std::size_t line = 0;
  std::string joined;
  const auto begin = [&](std::string_view name) {
    for (const std::size_t point : used) index_in_mesh[point] = 0;
    used.clear();
    builder.begin(name);
  };
  begin("");
  while (!bytes.empty()) {
    std::string_view text = read_line(bytes);
    ++line;
    // a line continued on the next one
    joined.clear();
    while (text.ends_with('\\') && !bytes.empty()) {
      joined += std::string(text.substr(0, text.size() - 1)) + " ";
      text = read_line(bytes);
      ++line;
    }
    if (!joined.empty()) text = joined += text;
    if (text.size() > kMaxMeshLine) return builder.damaged(at_line(line, "does not end"));
    const auto words = split_spaces(text);
    if (words.empty()) continue;
    if (words[0].starts_with('#')) {
      builder.read_space(text);
    } else if (words[0] == "v") {
      if (words.size() < 4) return builder.damaged(at_line(line, "is not a vertex of three numbers"));
      Eigen::Vector3d point;
      for (int a = 0; a < 3; ++a) {
        const auto number = mesh_number(words[static_cast<std::size_t>(a) + 1]);
        if (!number) return builder.damaged(at_line(line, "is not a vertex of three numbers"));
        point[a] = *number;
      }
      if (points.size() == kMaxPoints) return builder.too_many();
      points.push_back(point);
      index_in_mesh.push_back(0);
      consumed.push_back(false);
    } else if (words[0] == "o" || (words[0] == "g" && !objects)) {
      objects = words[0] == "o";
      begin(text.substr(text.find(words[0]) + 1));
    } else if (words[0] == "f") {
      corners.clear();
      if (words.size() < 4) return builder.damaged(at_line(line, "is a face with fewer than three corners"));
      // the keyword, and two corners more than the resulting fan has triangles
      if (words.size() > kMaxTriangles + 3) return builder.too_many();
      for (std::size_t n = 1; n < words.size(); ++n) {
        const auto number = parse_number<std::int64_t>(words[n].substr(0, words[n].find('/')));
        // 1-based, or negative: relative to the end
        const auto count = static_cast<std::int64_t>(points.size());
        const std::int64_t point = !number ? -1 : *number > 0 ? *number - 1 : count + *number;
        if (!number || *number == 0 || point < 0 || point >= count)
          return builder.damaged(at_line(line, "is a face with missing corners"));
        const auto at = static_cast<std::size_t>(point);
        if (index_in_mesh[at] == 0) {
          builder.add_point(points[at]);
          index_in_mesh[at] = static_cast<std::uint32_t>(builder.points());
          used.push_back(at);
          // groups that share points are parts of one surface, for example by material; objects are not
          groups_share_points = groups_share_points || consumed[at];
          consumed[at] = true;
        }
        corners.push_back(static_cast<std::int64_t>(index_in_mesh[at]) - 1);
      }
      if (!builder.add_polygon(corners)) return builder.damaged(at_line(line, "is not a face"));
    }
    // normals, texture coordinates, materials and lines do not affect the surface
  }
  if (groups_share_points && !objects) builder.join();
  return builder.finish();
}

Result<MeshFile> parse_ply(std::string_view bytes, MeshBuilder builder) {
  builder.begin("");
  const auto header = parse_ply_header(bytes, builder);
  if (!header) return header.error();
  PlyValues values(bytes, header->order);
  std::vector<std::int64_t> corners;
  bool has_points = false;
  for (const PlyElement& element : header->elements) {
    std::array<int, 3> indices{-1, -1, -1};
    int face = -1;
    for (std::size_t n = 0; n < element.properties.size(); ++n) {
      const PlyProperty& property = element.properties[n];
      const int index = static_cast<int>(n);
      if (!property.count && element.name == "vertex")
        for (std::size_t a = 0; a < 3; ++a)
          if (property.name == std::string(1, static_cast<char>('x' + a))) indices[a] = index;
      if (property.count && element.name == "face" &&
          (property.name == "vertex_indices" || property.name == "vertex_index"))
        face = index;
    }
    const bool is_points = element.name == "vertex", is_faces = element.name == "face";
    if (is_points && std::ranges::find(indices, -1) != indices.end())
      return builder.damaged("its points lack an x, y or z");
    if (is_faces && face < 0) return builder.damaged("its faces lack their vertex_indices");
    if (is_faces && !has_points) return builder.damaged("its faces come before its points");
    // elements without properties take no bytes, so their count is unlimited
    if (element.properties.empty()) continue;
    for (std::uint64_t n = 0; n < element.count; ++n) {
      Eigen::Vector3d point = Eigen::Vector3d::Zero();
      for (std::size_t p = 0; p < element.properties.size(); ++p) {
        const PlyProperty& property = element.properties[p];
        const auto first = values.next(property.count.value_or(property.type));
        const auto ends = [&] {
          return builder.damaged(truncation_text(n, element.count, "of its elements '" + element.name + "'"));
        };
        if (!first) return ends();
        if (!property.count) {
          for (std::size_t a = 0; a < 3; ++a)
            if (indices[a] == static_cast<int>(p)) point[static_cast<int>(a)] = *first;
          continue;
        }
        if (!(*first >= 0 && *first <= static_cast<double>(values.left()))) return ends();
        const bool is_face = static_cast<int>(p) == face;
        if (is_face && *first > static_cast<double>(kMaxTriangles + 2)) return builder.too_many();
        corners.clear();
        for (double corner = 0; corner < *first; ++corner) {
          const auto value = values.next(property.type);
          // other lists, such as colours or texture coordinates, may contain NaN
          if (!value || (is_face && !(std::abs(*value) < 1e18))) return ends();
          if (is_face) corners.push_back(static_cast<std::int64_t>(*value));
        }
        if (is_face && !builder.add_polygon(corners))
          return builder.damaged("face " + std::to_string(n + 1) + " has missing corners");
      }
      if (is_points) builder.add_point(point);
    }
    has_points = has_points || is_points;
  }
  return builder.finish();
}

}  // namespace palpate::volume_io
