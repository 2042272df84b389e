#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/haptics/scope.h"

namespace palpate {

/// What a scope in a session's second device sees: a place that lies in its round field, before which nothing
/// that is felt stands, as the tissue was at the beginning. The tools do not stand before anything.
///
/// What stands before it is told by the labels, half of a structure's share where they are interpolated, in
/// steps of half a voxel; the last of the way, twice the widest voxel, is not looked at: there is what is
/// touched. A camera within something felt sees nothing. Immutable.
class ScopeSight {
 public:
  /// @param model  with its labels
  ScopeSight(const ScopeOptics& optics, const Model& model);

  /// Whether the scope of a tick's second device sees a place. Nothing is seen where its pose is not known.
  /// @param place_mm  patient, finite
  bool sees(const TickRecord& tick, const Eigen::Vector3d& place_mm) const;

 private:
  bool is_solid(const Point<Patient>& at) const;

  ScopeOptics optics_;
  std::shared_ptr<const Bricks<LabelId>> labels_;
  std::vector<bool> is_felt_;  // by LabelId
  Transform<World, Patient> X_WorldPatient_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  double step_mm_, touched_mm_;
};

}  // namespace palpate
