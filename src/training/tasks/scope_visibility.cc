#include "palpate/tasks/scope_visibility.h"

#include <array>
#include <cmath>
#include <numbers>

#include "palpate/contact/recorded_pose.h"

namespace palpate {
namespace {

// maximum viewing distance
constexpr double kMaxViewing_mm = 500;
// larger coordinates are invalid
constexpr double kNowhere_mm = 1e6;

Point<Patient> tip_outside_at(const DeviceTick& device) {
  const bool is_pushed_out = (device.flags & kFlagContact) != 0 && (device.flags & kFlagInside) == 0;
  const auto& at = is_pushed_out ? device.proxy_patient_mm : device.tip_patient_mm;
  return {at[0], at[1], at[2]};
}

}  // namespace

ScopeVisibility::ScopeVisibility(const ScopeOptics& optics, const Model& model)
    : optics_(optics),
      labels_(model.labels),
      X_WorldPatient_(model.X_WorldPatient),
      X_VoxelPatient_(model.labels->geometry().X_PatientVoxel().inverse()),
      step_mm_(0.5 * model.labels->geometry().spacing_mm.minCoeff()),
      touched_mm_(2 * model.labels->geometry().spacing_mm.maxCoeff()) {
  for (std::size_t label = 0; label < model.tissue_of_label.size(); ++label)
    is_touchable_.push_back(model.is_touchable(static_cast<LabelId>(label)));
}

bool ScopeVisibility::is_visible(const TickRecord& tick, const Eigen::Vector3d& position_mm) const {
  if (tick.devices < 2) return false;
  const DeviceTick& device = tick.device[1];
  const auto in_patient = [&](const Eigen::Vector3d& of_tool) {
    return tool_in_patient(X_WorldPatient_, tick, device, of_tool);
  };
  const Vector<Patient> view_direction = in_patient(view_direction_of(optics_));
  const Point<Patient> eye = tip_outside_at(device) + in_patient(camera_of(optics_));
  const Vector<Patient> displacement = Point<Patient>(position_mm) - eye;
  const double far_mm = displacement.norm();
  if (!(eye.eigen().cwiseAbs().maxCoeff() < kNowhere_mm) || !(view_direction.norm() > 0.5)) return false;
  if (!(far_mm > 0 && far_mm < kMaxViewing_mm)) return false;
  if (displacement.dot(view_direction) <
      std::cos(ScopeOptics::kHalfField_deg * std::numbers::pi / 180) * far_mm)
    return false;
  // the eye itself has to be outside tissue, however near the point is
  const Vector<Patient> ahead = displacement * (1 / far_mm);
  for (double at_mm = 0; at_mm == 0 || at_mm < far_mm - touched_mm_; at_mm += step_mm_)
    if (is_solid(eye + ahead * at_mm)) return false;
  return true;
}

// the nearest voxel is tested first, to avoid interpolation in free space
bool ScopeVisibility::is_solid(const Point<Patient>& at) const {
  const Point<Voxel> p = X_VoxelPatient_ * at;
  const auto touchable = [&](int i, int j, int k) {
    const LabelId label = labels_->anywhere(i, j, k);
    return label < is_touchable_.size() && is_touchable_[label];
  };
  if (!touchable(static_cast<int>(std::lround(p[0])), static_cast<int>(std::lround(p[1])),
                 static_cast<int>(std::lround(p[2]))))
    return false;
  const std::array<int, 3> low{static_cast<int>(std::floor(p[0])), static_cast<int>(std::floor(p[1])),
                               static_cast<int>(std::floor(p[2]))};
  double fraction = 0;
  for (int corner = 0; corner < 8; ++corner) {
    double weight = 1;
    std::array<int, 3> voxel = low;
    for (int axis = 0; axis < 3; ++axis) {
      const double part = p[axis] - low[axis];
      const bool high = (corner >> axis & 1) != 0;
      voxel[axis] += high ? 1 : 0;
      weight *= high ? part : 1 - part;
    }
    if (weight > 0 && touchable(voxel[0], voxel[1], voxel[2])) fraction += weight;
  }
  return fraction > 0.5;
}

}  // namespace palpate
