#pragma once

#include <cstdint>
#include <optional>

#include "palpate/device/device.h"

/// Mapping between a device's workspace and the patient: scale, force gain, clutch, orientation, home.
namespace palpate {

/// Placement and scaling of one device in the workspace.
struct WorkspaceSettings {
  double scale = 1;       ///< Patient mm per device mm; kMinScale ... kMaxScale
  double force_gain = 1;  ///< Device N per patient N; kMinScale ... kMaxScale
  double yaw_deg = 0;     ///< Rotation of the device about World's up axis, for where the person sits
  /// Position of the centre of the device's workspace; empty: World's origin, the volume's centre.
  std::optional<Point<World>> home;
  int clutch_button = -1;  ///< Button that acts as clutch, 0 ... 31; any other number: none
};
/// Range of scale and force gain.
inline constexpr double kMinScale = 0.05, kMaxScale = 20;

/// Maps a device's samples to the workspace and forces back: p_World = home + s R (p - middle) + o, where R
/// combines the device's axes and the user's yaw, and o is the offset accumulated by the clutch. Forces are
/// already multiplied by the gain g, torques by g / s (DeviceParameters), so that the output stage limits
/// what the device actually receives. A tissue of stiffness K is therefore rendered as s g K
/// (RenderedStiffness), and work at the device is g / s of the work in the patient, for forces and torques
/// alike.
class WorkspaceMapping {
 public:
  WorkspaceMapping(const DeviceInfo& info, const WorkspaceSettings& settings);

  /// While the clutch is held the tip stays at the position at which it was pressed, bit for bit; after
  /// release the device continues from there. A non-finite tip is passed on unchanged and not stored.
  /// @param now_ns  on the monotonic clock; determines the sample's age. The age is negative for a sample
  ///                from the future, produced by a driver with another clock; beyond a millisecond the output
  ///                stage gives it no force.
  DeviceState to_world(const DeviceSample& sample, std::int64_t now_ns);
  DeviceCommand to_device(const Wrench& wrench) const;
  /// Device position that maps to `tip`; for simulated hands.
  Point<Device> to_device(const Point<World>& tip) const;

 private:
  Rotation<World, Device> R_WorldDevice_;
  double scale_;
  Point<World> home_;  // including the clutch's offset
  Point<Device> middle_;
  std::uint32_t clutch_mask_;
  std::optional<Point<World>> held_;  // position of the tip while the clutch is held
};

/// State of a device whose samples are positions in the patient (DeviceInfo::in_patient).
/// @param X_WorldPatient  pose of the patient, including the object's current rotation
/// @param now_ns          as for WorkspaceMapping::to_world
DeviceState state_in_patient(const DeviceSample& sample, const Transform<World, Patient>& X_WorldPatient,
                             std::int64_t now_ns);

}  // namespace palpate
