#include <cmath>
#include <numbers>

#include "palpate/device/workspace.h"

namespace palpate {
namespace {

Rotation<World, Device> axes_of(const DeviceInfo& info, const WorkspaceSettings& settings) {
  const double yaw = settings.yaw_deg * std::numbers::pi / 180;
  return Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), yaw) * info.R_WorldDevice;
}

Point<Device> middle_of(const DeviceInfo& info) {
  if (!info.workspace) return {};
  return info.workspace->low + (info.workspace->high - info.workspace->low) * 0.5;
}

// 0 for a button that does not exist
std::uint32_t button_mask(int button) {
  return button >= 0 && button < 32 ? 1u << button : 0;
}

// quantities that the mapping leaves unchanged
void copy_unmapped(const DeviceSample& sample, std::int64_t now_ns, DeviceState& state) {
  state.gripper_rad = sample.gripper_rad;
  state.buttons = sample.buttons;
  if (sample.fault) state.status |= kDeviceFault;
  if (sample.set_down) state.status |= kDeviceSetDown;
  // subtracted as doubles, because extreme sample times could overflow an integer
  state.age_s = (static_cast<double>(now_ns) - static_cast<double>(sample.taken_ns)) * 1e-9;
}

}  // namespace

WorkspaceMapping::WorkspaceMapping(const DeviceInfo& info, const WorkspaceSettings& settings)
    : R_WorldDevice_(axes_of(info, settings)),
      scale_(settings.scale),
      home_(settings.home.value_or(Point<World>())),
      middle_(middle_of(info)),
      clutch_mask_(button_mask(settings.clutch_button)) {
  PALPATE_CHECK(settings.scale >= kMinScale && settings.scale <= kMaxScale);
  PALPATE_CHECK(std::isfinite(settings.yaw_deg) && home_.all_finite());
}

DeviceState WorkspaceMapping::to_world(const DeviceSample& sample, std::int64_t now_ns) {
  DeviceState state;
  const Vector<World> from_home = R_WorldDevice_ * (sample.tip - middle_) * scale_;
  state.tip = home_ + from_home;
  if ((sample.buttons & clutch_mask_) == 0) {
    held_.reset();
  } else {
    state.status |= kDeviceClutched;
    // home follows the device so that the tip stays in place; after release the device continues from there
    if (state.tip.all_finite()) {
      if (!held_) held_ = state.tip;
      home_ = *held_ - from_home;
      state.tip = *held_;
    }
  }

  state.R_WorldTool = R_WorldDevice_.quaternion() * sample.R_DeviceTool;
  state.velocity_mm_s = R_WorldDevice_ * sample.velocity_mm_s * scale_;
  state.angular_velocity_rad_s = R_WorldDevice_ * sample.angular_velocity_rad_s;
  copy_unmapped(sample, now_ns, state);
  return state;
}

DeviceCommand WorkspaceMapping::to_device(const Wrench& wrench) const {
  const auto R_DeviceWorld = R_WorldDevice_.inverse();
  return {R_DeviceWorld * wrench.force_N, R_DeviceWorld * wrench.torque_Nmm, wrench.gripper_N};
}

Point<Device> WorkspaceMapping::to_device(const Point<World>& tip) const {
  return middle_ + R_WorldDevice_.inverse() * (tip - home_) / scale_;
}

DeviceState state_in_patient(const DeviceSample& sample, const Transform<World, Patient>& X_WorldPatient,
                             std::int64_t now_ns) {
  DeviceState state;
  state.tip = X_WorldPatient * Point<Patient>(sample.tip.eigen());
  state.R_WorldTool = Eigen::Quaterniond(X_WorldPatient.linear()) * sample.R_DeviceTool;
  state.velocity_mm_s = X_WorldPatient * Vector<Patient>(sample.velocity_mm_s.eigen());
  state.angular_velocity_rad_s = X_WorldPatient * Vector<Patient>(sample.angular_velocity_rad_s.eigen());
  copy_unmapped(sample, now_ns, state);
  return state;
}

}  // namespace palpate
