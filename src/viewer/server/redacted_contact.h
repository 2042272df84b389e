#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"
#include "palpate/server/viewer_host.h"

namespace palpate::server {

/// Contact of a tool with a scene's own labels, computed from the tool's pose and the total force only:
/// proxy, normal and structure can be published without revealing hidden structures.
class RedactedContact {
 public:
  /// @param scene  outlives this object
  explicit RedactedContact(const ViewedScene& scene);

  struct Touch {
    Eigen::Vector3d proxy_mm, normal;  ///< Patient frame; the normal is zero without contact
    double depth_mm = kNoValue;        ///< Distance from proxy to tip; NaN without contact
    LabelId label = 0;                 ///< Structure in contact; 0: none
  };
  /// @param tick    supplies the rotation of the object
  /// @param number  index of the device in `tick`
  Touch of(const TickRecord& tick, std::size_t number) const;

 private:
  double solid_at(const Eigen::Vector3d& position_mm) const;
  LabelId nearest_touchable(const Eigen::Vector3d& position_mm) const;
  double exit_distance_mm(const Eigen::Vector3d& from_mm, const Eigen::Vector3d& outward) const;

  const ViewedScene& scene_;
  Eigen::Matrix3d R_WorldPatient_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  std::vector<bool> is_touchable_;  ///< Indexed by label
  double step_mm_;
};

}  // namespace palpate::server
