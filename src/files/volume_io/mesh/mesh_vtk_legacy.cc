#include <algorithm>
#include <limits>
#include <span>

#include "volume_io/labels/label_text.h"
#include "volume_io/mesh/mesh.h"
#include "volume_io/mesh/vtk_values.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

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

}  // namespace palpate::volume_io
