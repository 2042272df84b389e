#include "volume_io/mesh/vtk_values.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {

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

std::int64_t as_index(double value) {
  return value >= 0 && value < 1e15 ? static_cast<std::int64_t>(value) : -1;
}

bool add_points(MeshBuilder& builder, const std::vector<double>& values) {
  for (std::size_t n = 0; n + 2 < values.size(); n += 3)
    builder.add_point({values[n], values[n + 1], values[n + 2]});
  return values.size() % 3 == 0;
}

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

}  // namespace palpate::volume_io
