#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"
#include "palpate/link/viewer_server.h"

namespace palpate::link {

/// Where a tool touches a scene's own labels, computed from the pose of the tool and the total force alone:
/// the proxy, normal and structure that a viewer may be told without being told what lies beneath.
class VeiledContact {
 public:
  /// @param scene  outlives this
  explicit VeiledContact(const ViewedScene& scene);

  struct Touch {
    Eigen::Vector3d proxy_mm, normal;  ///< patient; normal is zero where nothing is touched
    double depth_mm = kNotKnown;       ///< from proxy to tip; not a number without contact
    LabelId label = 0;                 ///< touched structure, 0: none
  };
  /// @param tick    whose rotation of the object applies
  /// @param number  of the device in `tick`
  Touch of(const TickRecord& tick, std::size_t number) const;

 private:
  double solid_at(const Eigen::Vector3d& place_mm) const;
  LabelId nearest_felt(const Eigen::Vector3d& place_mm) const;
  double way_out_mm(const Eigen::Vector3d& from_mm, const Eigen::Vector3d& outward) const;

  const ViewedScene& scene_;
  Eigen::Matrix3d R_WorldPatient_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  std::vector<bool> is_felt_;  ///< by label
  double step_mm_;
};

}  // namespace palpate::link
