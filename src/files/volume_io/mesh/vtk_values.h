#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "volume_io/mesh/mesh.h"

/// Numbers and cells of VTK's mesh files, in the legacy and in the XML format.
namespace palpate::volume_io {

inline constexpr std::string_view kBlank = " \t\r\n";
/// Maximum size of one array: the points of the maximum number of triangles.
inline constexpr std::uint64_t kMaxNumbers = 9 * kMaxTriangles;

struct VtkType {
  std::size_t bytes = 0;
  bool is_float = false, is_signed = true;
};

/// Type by its name in either format; nullopt if it is unknown.
std::optional<VtkType> vtk_type(std::string_view name);

/// Value of a number of at most 8 bytes.
double vtk_value(const char* bytes, VtkType type, bool big_endian);

/// Value as an index; -1 if it is invalid.
std::int64_t as_index(double value);

/// Adds points, given their coordinates; returns false if one is incomplete.
bool add_points(MeshBuilder& builder, const std::vector<double>& values);

enum class Cells { kPolygons, kStrips };

/// Adds a polygon or strip, given its corners; returns false if it is invalid.
/// @param first_point  added to each corner
bool add_cell(MeshBuilder& builder, Cells cells, std::span<const double> corners, std::int64_t first_point);

/// Adds several cells.
/// @param offsets  end of each cell in `corners`
bool add_cells(MeshBuilder& builder, Cells cells, const std::vector<double>& offsets,
               const std::vector<double>& corners, std::int64_t first_point);

}  // namespace palpate::volume_io
