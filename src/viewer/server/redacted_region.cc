#include "server/redacted_region.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "server/viewed_vectors.h"

namespace palpate::server {
namespace {

// as in session's view_of(): minimum share of a surface's area that has to face one side
constexpr double kMinOutwardFraction = 0.05;

std::vector<bool> set_of(const std::vector<LabelId>& labels) {
  std::vector<bool> has(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  for (const LabelId label : labels) has[label] = true;
  return has;
}

/// Labels that a tool can pass: air, and structures without contact or without a tissue.
std::vector<bool> free_labels(const ViewedScene& scene) {
  std::vector<bool> is_free(std::size_t{std::numeric_limits<LabelId>::max()} + 1, true);
  for (const ViewedStructure& structure : scene.structures)
    if (structure.label != 0 && structure.tissue >= 0)
      is_free[structure.label] = !scene.tissues[static_cast<std::size_t>(structure.tissue)].touchable;
  return is_free;
}

}  // namespace

RegionExtent::RegionExtent(const Bricks<LabelId>& labels, const ViewedTask::Region::Extent& extent)
    : labels_(labels), has_(set_of(extent.labels)), radius_mm_(extent.radius_mm) {
  if (extent.centre_mm) centre_mm_ = vector_of(*extent.centre_mm);
  for (const auto& plane : extent.planes)
    planes_.push_back({vector_of(plane.point_mm), vector_of(plane.normal)});
  if (extent.landmark) centre_mm_ = farthest(vector_of(*extent.landmark));
  if (extent.half) planes_.push_back({middle_of_all(), vector_of(*extent.half)});
}

bool RegionExtent::contains_point(const Eigen::Vector3d& position_mm) const {
  if (centre_mm_ && !((position_mm - *centre_mm_).norm() <= radius_mm_)) return false;
  return std::ranges::all_of(
      planes_, [&](const Plane& plane) { return (position_mm - plane.point_mm).dot(plane.normal) >= 0; });
}

Eigen::Vector3d RegionExtent::middle_of_all() const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for_each_of_labels([&](int, int, int, const Eigen::Vector3d& position_mm) {
    sum += position_mm;
    ++count;
  });
  return sum / std::max(count, 1.0);
}

// mean of all farthest voxels, so that the order of voxels does not matter
Eigen::Vector3d RegionExtent::farthest(const Eigen::Vector3d& direction) const {
  constexpr double kAsFar_mm = 1e-6;
  double largest = -std::numeric_limits<double>::infinity(), count = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for_each_of_labels([&](int, int, int, const Eigen::Vector3d& position_mm) {
    const double far = position_mm.dot(direction);
    if (far > largest + kAsFar_mm) {
      largest = far;
      sum.setZero();
      count = 0;
    }
    if (far > largest - kAsFar_mm) {
      sum += position_mm;
      ++count;
    }
  });
  return sum / std::max(count, 1.0);
}

ViewedTask::Region region_in(const ViewedScene& scene, const ViewedTask::Region& region) {
  // a sphere does not depend on labels
  if (region.extent && region.extent->labels.empty()) return region;
  const GridGeometry& grid = scene.labels->geometry();
  const Eigen::Matrix3d axes = grid.direction * grid.spacing_mm.asDiagonal();
  const Eigen::Vector3d dims(grid.dims[0], grid.dims[1], grid.dims[2]);
  ViewedTask::Region view{
      region.name, array_of(grid.centre().eigen()), 0.5 * (axes * dims).norm(), {}, region.extent};
  if (!region.extent) return view;
  const RegionExtent extent(*scene.labels, *region.extent);
  const std::vector<bool> is_free = free_labels(scene);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), outward = Eigen::Vector3d::Zero();
  double count = 0, faces = 0;
  extent.for_each_voxel([&](int i, int j, int k, const Eigen::Vector3d& position) {
    sum += position;
    ++count;
    for (int axis = 0; axis < 3; ++axis)
      for (const int side : {1, -1}) {
        const std::array<int, 3> step{axis == 0 ? side : 0, axis == 1 ? side : 0, axis == 2 ? side : 0};
        const LabelId beside = scene.labels->anywhere(i + step[0], j + step[1], k + step[2]);
        if (extent.has(beside) || !is_free[beside]) continue;
        // weighted by the face's area: the voxel's volume divided by its height
        const Eigen::Vector3d out = side * axes.col(axis);
        outward += out / out.squaredNorm();
        faces += 1 / out.norm();
      }
  });
  if (count == 0) return view;
  const Eigen::Vector3d centre = sum / count;
  view.centre_mm = array_of(centre);
  view.radius_mm = 0;
  extent.for_each_voxel([&](int, int, int, const Eigen::Vector3d& at_position) {
    view.radius_mm = std::max(view.radius_mm, (at_position - centre).norm());
  });
  if (outward.norm() > kMinOutwardFraction * faces) view.outward = array_of(outward.normalized());
  return view;
}

}  // namespace palpate::server
