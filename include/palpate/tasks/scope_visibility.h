#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/contact/scope.h"
#include "palpate/device/telemetry.h"

namespace palpate {

/// Visibility through a scope held by a session's second device: a point is visible if it is within the
/// circular field of view and no touchable tissue occludes it, in its state at the start of the session.
/// Tools do not occlude.
///
/// Occlusion is tested by ray marching through the labels in steps of half a voxel; a point is occluded where
/// the interpolated fraction of touchable labels exceeds one half. The last part of the ray, twice the
/// largest voxel spacing, is skipped, because it is in the touched structure. A camera inside touchable
/// tissue sees nothing. Immutable.
class ScopeVisibility {
 public:
  /// @param model  a model with labels
  ScopeVisibility(const ScopeOptics& optics, const Model& model);

  /// Whether the scope of the tick's second device sees a point. False if its pose is unknown.
  /// @param position_mm  patient frame, finite
  bool is_visible(const TickRecord& tick, const Eigen::Vector3d& position_mm) const;

 private:
  bool is_solid(const Point<Patient>& at) const;

  ScopeOptics optics_;
  std::shared_ptr<const Bricks<LabelId>> labels_;
  std::vector<bool> is_touchable_;  // by LabelId
  Transform<World, Patient> X_WorldPatient_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  double step_mm_, touched_mm_;
};

}  // namespace palpate
