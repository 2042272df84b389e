#pragma once

#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

#include "palpate/geometry/geometry.h"

/// Camera of an arthroscope, from the pose of its shaft. Identical to the page's scope view
/// (web/src/volume/scope.ts), so that what a task counts as visible is visible there.
namespace palpate {

/// Geometry of an arthroscope. The shaft extends from the tip along the tool's z axis; in the neutral
/// rotation the optics are inclined towards the tool's y axis.
struct ScopeOptics {
  double lean_deg = 30;  ///< Angle between the shaft and the viewing direction, 0 ... 90
  double back_mm = 8;    ///< Distance from the tip back along the shaft to the camera
  /// Half of the angle of view.
  static constexpr double kHalfField_deg = 40;

  friend bool operator==(const ScopeOptics&, const ScopeOptics&) = default;
};

/// Position of the camera in the tool's frame, relative to the tip; mm.
inline Eigen::Vector3d camera_of(const ScopeOptics& optics) {
  return {0, 0, optics.back_mm};
}
/// Viewing direction in the tool's frame; unit.
inline Eigen::Vector3d view_direction_of(const ScopeOptics& optics) {
  const double lean = optics.lean_deg * std::numbers::pi / 180;
  return {0, std::sin(lean), -std::cos(lean)};
}

/// Attitude of a scope whose camera looks along a direction. Among the attitudes with that viewing direction,
/// the one whose shaft direction (the tool's z axis, from the tip to the handle) is closest to `upper`; an
/// arbitrary one if view_direction and upper are parallel.
/// @param view_direction, upper  directions in World; not zero
inline Eigen::Quaterniond attitude_looking_along(const ScopeOptics& optics,
                                                 const Vector<World>& view_direction,
                                                 const Vector<World>& upper) {
  const Eigen::Vector3d forward = view_direction.normalized().eigen();
  Eigen::Vector3d right = forward.cross(upper.eigen());
  if (!(right.norm() > 1e-6 * upper.norm())) right = forward.unitOrthogonal();
  right.normalize();
  // camera axes in the world, then in the tool
  Eigen::Matrix3d R_WorldCamera;
  R_WorldCamera << right, right.cross(forward), -forward;
  const Eigen::AngleAxisd R_ToolCamera(optics.lean_deg * std::numbers::pi / 180, Eigen::Vector3d::UnitX());
  return Eigen::Quaterniond(R_WorldCamera * R_ToolCamera.toRotationMatrix().transpose());
}

}  // namespace palpate
