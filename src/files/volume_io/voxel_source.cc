#include "volume_io/voxel_source.h"

#include <cmath>
#include <limits>

#include "palpate/base/reading.h"
#include "volume_io/formats/headers.h"

namespace palpate::volume_io {

std::size_t bytes_of(Component component) {
  return with_type(component, [](auto type) { return sizeof(type); });
}

const char* name_of(Component component) {
  switch (component) {
    case Component::kInt8:
      return "int8";
    case Component::kUint8:
      return "uint8";
    case Component::kInt16:
      return "int16";
    case Component::kUint16:
      return "uint16";
    case Component::kInt32:
      return "int32";
    case Component::kUint32:
      return "uint32";
    case Component::kInt64:
      return "int64";
    case Component::kUint64:
      return "uint64";
    case Component::kFloat32:
      return "float32";
    case Component::kFloat64:
      break;
  }
  return "float64";
}

Result<std::array<int, 3>> volume_dims(const std::vector<std::int64_t>& axes, const std::string& source) {
  constexpr std::int64_t kMaxVoxels = std::int64_t{1} << 40;
  if (axes.size() < 2)
    return bad_input(source, "has " + std::to_string(axes.size()) + " axis, but a volume has three",
                     "give a volume, or a single slice with two axes");
  std::array<int, 3> dims{1, 1, 1};
  std::int64_t voxels = 1;
  for (std::size_t a = 0; a < axes.size(); ++a) {
    if (axes[a] < 1)
      return bad_input(source, "axis " + std::to_string(a + 1) + " has a size of " + std::to_string(axes[a]));
    if (a >= 3) {
      if (axes[a] == 1) continue;
      return bad_input(source, "has " + std::to_string(axes.size()) + " axes, but a volume has three",
                       "extract one volume of the series and give that");
    }
    if (axes[a] > std::numeric_limits<int>::max() || axes[a] > kMaxVoxels / voxels)
      return bad_input(source, "states more voxels than any scan has: the header is damaged");
    voxels *= axes[a];
    dims[a] = static_cast<int>(axes[a]);
  }
  return dims;
}

Result<GridGeometry> checked(const GridGeometry& geometry, const std::string& source) {
  if (!geometry.spacing_mm.allFinite() || !geometry.direction.allFinite() || !geometry.origin.all_finite())
    return bad_input(source, "its geometry contains a non-finite value");
  if (geometry.spacing_mm.minCoeff() <= 0) return bad_input(source, "its spacing is not positive");
  // columns are unit vectors: the determinant is the volume of their parallelepiped, 1 if they are orthogonal
  constexpr double kFlat = 1e-3;
  if (std::abs(geometry.direction.determinant()) < kFlat)
    return bad_input(source, "its axes lie in one plane and span no volume",
                     "repair its directions from the scan");
  return geometry;
}

Result<GridGeometry> grid_of(const HeaderGeometry& geometry, const std::array<int, 3>& dims,
                             const std::string& source) {
  GridGeometry grid;
  grid.dims = dims;
  grid.spacing_mm = geometry.spacing_mm;
  grid.origin = Point<Patient>(geometry.origin_mm);
  grid.direction = geometry.direction;
  return checked(grid, source);
}

Result<std::filesystem::path> data_file_beside(const std::filesystem::path& header, const std::string& name) {
  const std::filesystem::path relative(name);
  bool leads_out = relative.is_absolute();
  for (const auto& part : relative) leads_out |= part == "..";
  if (relative.empty() || name.find('\0') != std::string::npos ||
      (leads_out && !reading_limits().follow_links))
    return bad_input(header.string(), "names a data file outside its own folder",
                     "put the data file next to the header and name it without a path, or, if its location "
                     "is intended, allow it with --follow-links");
  const std::filesystem::path file = header.parent_path() / relative;
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored))
    return bad_input(header.string(), "its data file " + relative.string() + " is missing",
                     "put the data file next to the header");
  if (auto stays = check_stays_in(header.parent_path(), file); !stays) return stays.error();
  return file;
}

}  // namespace palpate::volume_io
