#pragma once

#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"

namespace palpate {

/// Transforms a vector fixed in the workspace to the patient frame by the object rotation of a recorded tick.
/// Zero if the vector is not finite or the rotation is invalid.
/// @param X_WorldPatient  Model::X_WorldPatient
/// @param tick            recorded tick
/// @param v               vector in World
inline Vector<Patient> in_patient(const Transform<World, Patient>& X_WorldPatient, const TickRecord& tick,
                                  const Vector<World>& v) {
  const auto& w = tick.rotation_applied_wxyz;
  const Eigen::Quaterniond rotation(w[0], w[1], w[2], w[3]);
  if (!v.all_finite() || !rotation.coeffs().allFinite() || !(rotation.squaredNorm() > 0)) return {};
  return X_WorldPatient.inverse() * (Rotation<World, World>(rotation).inverse() * v);
}

/// Transforms a vector fixed to a device's tool to the patient frame by the recorded orientation of the
/// device.
/// @param of_tool  vector in the tool's frame
inline Vector<Patient> tool_in_patient(const Transform<World, Patient>& X_WorldPatient,
                                       const TickRecord& tick, const DeviceTick& device,
                                       const Eigen::Vector3d& of_tool) {
  const auto& w = device.orientation_wxyz;
  const Eigen::Quaterniond rotation(w[0], w[1], w[2], w[3]);
  if (!rotation.coeffs().allFinite() || !(rotation.squaredNorm() > 0)) return {};
  return in_patient(X_WorldPatient, tick, Vector<World>(rotation.normalized() * of_tool));
}

}  // namespace palpate
