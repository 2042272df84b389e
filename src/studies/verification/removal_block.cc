#include "verification/removal_block.h"

#include <cmath>

#include "palpate/surfaces/surfaces.h"
#include "palpate/volume/bricks.h"

namespace palpate {
namespace {

// an even number of voxels on the grids that are not rotated
constexpr double kHalfBlock_mm = 10.2, kDepth_mm = 8.4;

}  // namespace

Result<std::shared_ptr<const Surface>> bone_block(const BlockGrid& on, const Progress& progress) {
  const Eigen::Matrix3d direction =
      Eigen::AngleAxisd(on.turned_rad, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  // half diagonal of the block, plus a millimetre
  const double half_mm = std::hypot(kHalfBlock_mm, kHalfBlock_mm, 0.5 * kDepth_mm) + 1;
  const int half = static_cast<int>(half_mm / on.voxel_mm);
  GridGeometry grid;
  grid.dims = {2 * half, 2 * half, 2 * half};
  grid.spacing_mm = Eigen::Vector3d::Constant(on.voxel_mm);
  grid.direction = direction;
  // the block's centre is between eight voxels
  const Eigen::Vector3d first = Eigen::Vector3d::Constant((0.5 - half) * on.voxel_mm);
  grid.origin = Point<Patient>(Eigen::Vector3d(direction * first) + Eigen::Vector3d(0, 0, -0.5 * kDepth_mm));
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Point<Patient> p = X_PatientVoxel * Point<Voxel>(i, j, k);
        if (std::abs(p.x()) < kHalfBlock_mm && std::abs(p.y()) < kHalfBlock_mm && p.z() < 0 &&
            p.z() > -kDepth_mm)
          labels.at(i, j, k) = 1;
      }
  auto prepared = prepare_surfaces(*label_bricks(labels), {1}, {}, progress);
  if (!prepared) return prepared.error();
  return std::make_shared<const Surface>(std::move(prepared->front().surface));
}

}  // namespace palpate
