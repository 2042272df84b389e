#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "palpate/server/viewed_training.h"
#include "palpate/server/viewer_host.h"

namespace palpate::server {

/// Voxels of a task's region in a label grid.
class RegionExtent {
 public:
  /// @param labels  outlives this object
  RegionExtent(const Bricks<LabelId>& labels, const ViewedTask::Region::Extent& extent);

  bool has(LabelId label) const { return has_[label]; }
  bool contains_point(const Eigen::Vector3d& position_mm) const;
  /// Calls visit(i, j, k, position_mm) for each voxel of the region.
  template <class Visit>
  void for_each_voxel(const Visit& visit) const {
    for_each_of_labels([&](int i, int j, int k, const Eigen::Vector3d& position_mm) {
      if (contains_point(position_mm)) visit(i, j, k, position_mm);
    });
  }

 private:
  struct Plane {
    Eigen::Vector3d point_mm, normal;
  };
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
  Eigen::Vector3d middle_of_all() const;
  Eigen::Vector3d farthest(const Eigen::Vector3d& direction) const;

  const Bricks<LabelId>& labels_;
  std::vector<bool> has_;
  std::optional<Eigen::Vector3d> centre_mm_;
  double radius_mm_;
  std::vector<Plane> planes_;
};

/// A task's region in a scene's own labels: centre, radius and outward direction are recomputed from
/// ViewedTask::Region::extent. A region without an extent, or without voxels in these labels, is the whole
/// volume.
ViewedTask::Region region_in(const ViewedScene& scene, const ViewedTask::Region& region);

}  // namespace palpate::server
