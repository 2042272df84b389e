#include <cmath>
#include <sstream>
#include <string>

#include "palpate/volume/grid.h"

namespace palpate {
namespace {

// tolerance of a direction's length, and least determinant of the direction matrix: axes that span a volume
constexpr double kUnitTolerance = 0.01, kMinDeterminant = 1e-3;

template <class... Parts>
Error bad_grid(const char* member, const char* remedy, const Parts&... parts) {
  std::ostringstream what;
  (what << ... << parts);
  return {ErrorKind::kBadInput, what.str(), member, remedy};
}

}  // namespace

Result<void> check_grid(const GridGeometry& grid) {
  for (const int dim : grid.dims)
    if (dim < 1 || dim > kMaxGridVoxels)
      return bad_grid("dims", "give 1 to 1048576 voxels along each axis", "a grid of ", grid.dims[0], " x ",
                      grid.dims[1], " x ", grid.dims[2], " voxels");
  for (const double spacing_mm : grid.spacing_mm)
    if (!(spacing_mm >= kMinSpacing_mm && spacing_mm <= kMaxSpacing_mm))
      return bad_grid("spacing_mm", "give the distance of voxel centres along each axis, 0.0001 to 1000 mm",
                      "a voxel spacing of ", spacing_mm, " mm");
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::abs(grid.direction.col(axis).norm() - 1) <= kUnitTolerance))
      return bad_grid("direction", "its columns are the unit vectors of the voxel axes in the patient",
                      "the direction of axis ", axis, " has the length ", grid.direction.col(axis).norm());
  if (!(std::abs(grid.direction.determinant()) >= kMinDeterminant))
    return bad_grid("direction", "its columns are the unit vectors of the voxel axes in the patient",
                    "the voxel axes lie in a plane");
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::abs(grid.origin[axis]) <= kMaxOrigin_mm))
      return bad_grid("origin", "give the centre of the first voxel in the patient, mm", "an origin at ",
                      grid.origin[axis], " mm");
  return {};
}

}  // namespace palpate
