#include "palpate/palpation/scope_hand.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/palpation/plain_vectors.h"

namespace palpate {
namespace {

constexpr double kAbove_mm = 30;
constexpr double kTurning_rad_s = std::numbers::pi;
constexpr double kThere_mm = 0.5, kThere_rad = 2 * std::numbers::pi / 180;

}  // namespace

ScopeHand::ScopeHand(const Model& model, const Point<World>& start) : model_(&model) {
  state_.tip = start + Vector<World>(0, 0, kAbove_mm);
  eye_ = state_.tip;
}

void ScopeHand::advance(const TickRecord& tick, double dt_s) {
  if (!step_) return;
  const auto X = rotated_object_pose(model_->X_WorldPatient, quaternion(tick.rotation_applied_wxyz));
  const auto& probe = tick.device[0].tip_world_mm;
  const Point<World> at = step_->at ? X * *step_->at : Point<World>(probe[0], probe[1], probe[2]);
  const Point<World> target = at + X * step_->from * step_->distance_mm;
  const Vector<World> displacement = target - eye_;
  const double step_mm = step_->speed_mm_s * dt_s;
  eye_ = displacement.norm() <= step_mm ? target : eye_ + displacement.normalized() * step_mm;

  // at the target itself the viewing direction is undefined
  const Vector<World> view_direction = at - eye_;
  const Vector<World> superior = X * Vector<Patient>(0, 0, 1);
  const Rotation<World, World> current_attitude(state_.R_WorldTool);
  const Rotation<World, World> looking(view_direction.norm() > 0
                                           ? attitude_looking_along(step_->optics, view_direction, superior)
                                           : state_.R_WorldTool);
  const double angle = current_attitude.quaternion().angularDistance(looking.quaternion());
  const double part = angle > 0 ? std::min(1.0, kTurning_rad_s * dt_s / angle) : 1;
  state_.R_WorldTool = current_attitude.slerp(part, looking).quaternion();
  state_.tip = eye_ - Vector<World>(state_.R_WorldTool * camera_of(step_->optics));
  is_there_ = (target - eye_).norm() < kThere_mm && (1 - part) * angle < kThere_rad;
}

}  // namespace palpate
