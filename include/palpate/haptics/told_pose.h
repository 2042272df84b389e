#pragma once

#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"

namespace palpate {

/// What is fixed to the workspace in a recorded tick, turned into the patient as the object was felt then;
/// zero where one of them is no rotation or not finite.
/// @param X_WorldPatient  Model::X_WorldPatient
inline Vector<Patient> in_patient(const Transform<World, Patient>& X_WorldPatient, const TickRecord& tick,
                                  const Vector<World>& v) {
  const auto& w = tick.rotation_felt_wxyz;
  const Eigen::Quaterniond felt(w[0], w[1], w[2], w[3]);
  if (!v.all_finite() || !felt.coeffs().allFinite() || !(felt.squaredNorm() > 0)) return {};
  return X_WorldPatient.inverse() * (Rotation<World, World>(felt).inverse() * v);
}

/// The same of what is fixed to a device's tool, by the orientation that the tick tells.
inline Vector<Patient> tool_in_patient(const Transform<World, Patient>& X_WorldPatient,
                                       const TickRecord& tick, const DeviceTick& device,
                                       const Eigen::Vector3d& of_tool) {
  const auto& w = device.orientation_wxyz;
  const Eigen::Quaterniond held(w[0], w[1], w[2], w[3]);
  if (!held.coeffs().allFinite() || !(held.squaredNorm() > 0)) return {};
  return in_patient(X_WorldPatient, tick, Vector<World>(held.normalized() * of_tool));
}

}  // namespace palpate
