#include "link/veiled_region.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "link/viewed_vectors.h"

namespace palpate::link {
namespace {

// as session's view_of(): where most of a surface's area faces one side
constexpr double kLeastOutwardShare = 0.05;

std::vector<bool> set_of(const std::vector<LabelId>& labels) {
  std::vector<bool> has(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  for (const LabelId label : labels) has[label] = true;
  return has;
}

/// Labels through which a tool may come: air, and structures of tissues that are not felt or of none.
std::vector<bool> free_labels(const ViewedScene& scene) {
  std::vector<bool> is_free(std::size_t{std::numeric_limits<LabelId>::max()} + 1, true);
  for (const ViewedStructure& structure : scene.structures)
    if (structure.label != 0 && structure.tissue >= 0)
      is_free[structure.label] = !scene.tissues[static_cast<std::size_t>(structure.tissue)].felt;
  return is_free;
}

struct Plane {
  Eigen::Vector3d point_mm, normal;
};

class Extent {
 public:
  Extent(const ViewedScene& scene, const ViewedTask::Region::Extent& extent)
      : labels_(*scene.labels), has_(set_of(extent.labels)), radius_mm_(extent.radius_mm) {
    if (extent.centre_mm) centre_mm_ = vector_of(*extent.centre_mm);
    for (const auto& plane : extent.planes)
      planes_.push_back({vector_of(plane.point_mm), vector_of(plane.normal)});
    if (extent.landmark) centre_mm_ = farthest(vector_of(*extent.landmark));
    if (extent.half) planes_.push_back({middle_of_all(), vector_of(*extent.half)});
  }

  bool has(LabelId label) const { return has_[label]; }
  /// Calls visit(i, j, k, place) for each voxel of the region.
  template <class Visit>
  void for_each_voxel(const Visit& visit) const {
    for_each_of_labels([&](int i, int j, int k, const Eigen::Vector3d& place) {
      if (bounds(place)) visit(i, j, k, place);
    });
  }

 private:
  template <class Visit>
  void for_each_of_labels(const Visit& visit) const {
    const auto X = labels_.geometry().X_PatientVoxel();
    labels_.for_each_piece([&](const auto& piece) {
      if (piece.uniform && !has_[piece.voxels[0]]) return;
      for (int n = 0; n < piece.count; ++n)
        if (has_[piece.voxels[n]])
          visit(piece.i + n, piece.j, piece.k, (X * Point<Voxel>(piece.i + n, piece.j, piece.k)).eigen());
    });
  }
  bool bounds(const Eigen::Vector3d& place) const {
    if (centre_mm_ && !((place - *centre_mm_).norm() <= radius_mm_)) return false;
    return std::ranges::all_of(
        planes_, [&](const Plane& plane) { return (place - plane.point_mm).dot(plane.normal) >= 0; });
  }
  Eigen::Vector3d middle_of_all() const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double count = 0;
    for_each_of_labels([&](int, int, int, const Eigen::Vector3d& place) {
      sum += place;
      ++count;
    });
    return sum / std::max(count, 1.0);
  }
  // the middle of all that are as far, so that the order of voxels does not decide
  Eigen::Vector3d farthest(const Eigen::Vector3d& direction) const {
    constexpr double kAsFar_mm = 1e-6;
    double most = -std::numeric_limits<double>::infinity(), count = 0;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for_each_of_labels([&](int, int, int, const Eigen::Vector3d& place) {
      const double far = place.dot(direction);
      if (far > most + kAsFar_mm) {
        most = far;
        sum.setZero();
        count = 0;
      }
      if (far > most - kAsFar_mm) {
        sum += place;
        ++count;
      }
    });
    return sum / std::max(count, 1.0);
  }

  const Bricks<LabelId>& labels_;
  std::vector<bool> has_;
  std::optional<Eigen::Vector3d> centre_mm_;
  double radius_mm_;
  std::vector<Plane> planes_;
};

}  // namespace

ViewedTask::Region region_in(const ViewedScene& scene, const ViewedTask::Region& region) {
  // a ball says where it is by itself
  if (region.extent && region.extent->labels.empty()) return region;
  const GridGeometry& grid = scene.labels->geometry();
  const Eigen::Matrix3d axes = grid.direction * grid.spacing_mm.asDiagonal();
  const Eigen::Vector3d dims(grid.dims[0], grid.dims[1], grid.dims[2]);
  ViewedTask::Region view{
      region.name, array_of(grid.centre().eigen()), 0.5 * (axes * dims).norm(), {}, region.extent};
  if (!region.extent) return view;
  const Extent extent(scene, *region.extent);
  const std::vector<bool> is_free = free_labels(scene);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), outward = Eigen::Vector3d::Zero();
  double count = 0, faces = 0;
  extent.for_each_voxel([&](int i, int j, int k, const Eigen::Vector3d& place) {
    sum += place;
    ++count;
    for (int axis = 0; axis < 3; ++axis)
      for (const int side : {1, -1}) {
        const std::array<int, 3> step{axis == 0 ? side : 0, axis == 1 ? side : 0, axis == 2 ? side : 0};
        const LabelId beside = scene.labels->anywhere(i + step[0], j + step[1], k + step[2]);
        if (extent.has(beside) || !is_free[beside]) continue;
        // weighted by the face's area, which is the voxel's volume over its height
        const Eigen::Vector3d out = side * axes.col(axis);
        outward += out / out.squaredNorm();
        faces += 1 / out.norm();
      }
  });
  if (count == 0) return view;
  const Eigen::Vector3d middle = sum / count;
  view.middle_mm = array_of(middle);
  view.radius_mm = 0;
  extent.for_each_voxel([&](int, int, int, const Eigen::Vector3d& place) {
    view.radius_mm = std::max(view.radius_mm, (place - middle).norm());
  });
  if (outward.norm() > kLeastOutwardShare * faces) view.outward = array_of(outward.normalized());
  return view;
}

}  // namespace palpate::link
