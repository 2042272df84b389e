#pragma once

#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

#include "palpate/geometry/geometry.h"

/// An arthroscope: where its camera is and looks, by how its shaft is held. As the page's scope view has it
/// (web/src/scope.ts), so that what a task takes for seen is what is to be seen there.
namespace palpate {

/// What a scope is made like. The shaft goes from its tip along the tool's z axis; at rest its optics lean
/// towards the tool's y axis.
struct ScopeOptics {
  double lean_deg = 30;  ///< between the shaft and where it looks, 0 ... 90
  double back_mm = 8;    ///< from the tip back along the shaft to the camera
  /// From the middle of what is seen to its border.
  static constexpr double kHalfField_deg = 40;

  friend bool operator==(const ScopeOptics&, const ScopeOptics&) = default;
};

/// From the tip to the camera, in the tool's frame, mm.
inline Eigen::Vector3d camera_of(const ScopeOptics& optics) {
  return {0, 0, optics.back_mm};
}
/// Where the camera looks, in the tool's frame, unit.
inline Eigen::Vector3d look_of(const ScopeOptics& optics) {
  const double lean = optics.lean_deg * std::numbers::pi / 180;
  return {0, std::sin(lean), -std::cos(lean)};
}

/// How a scope is to be held so that its camera looks along a direction. Of all the ways that there are the
/// one whose shaft comes from as far as can be in the direction of `upper`; where both are one line, any.
/// @param look, upper  World, not zero
inline Eigen::Quaterniond held_to_look(const ScopeOptics& optics, const Vector<World>& look,
                                       const Vector<World>& upper) {
  const Eigen::Vector3d forward = look.normalized().eigen();
  Eigen::Vector3d right = forward.cross(upper.eigen());
  if (!(right.norm() > 1e-6 * upper.norm())) right = forward.unitOrthogonal();
  right.normalize();
  // the camera's own axes, and how they stand in the tool
  Eigen::Matrix3d R_WorldCamera;
  R_WorldCamera << right, right.cross(forward), -forward;
  const Eigen::AngleAxisd R_ToolCamera(optics.lean_deg * std::numbers::pi / 180, Eigen::Vector3d::UnitX());
  return Eigen::Quaterniond(R_WorldCamera * R_ToolCamera.toRotationMatrix().transpose());
}

}  // namespace palpate
