#pragma once

#include <cstdint>
#include <optional>

#include "palpate/device/device.h"

/// How a device's workspace lies in the patient: scale, force gain, clutch, orientation, home.
namespace palpate {

/// How one device lies in the workspace, and how it is scaled.
struct WorkspaceSettings {
  double scale = 1;       ///< mm in the patient for one mm of the device; kLowestScale ... kHighestScale
  double force_gain = 1;  ///< N at the device for one N in the patient; likewise
  double yaw_deg = 0;     ///< turn of the device about World's up axis: where the person sits
  /// Where the middle of the device's workspace lies; empty: in World's origin, the volume's centre.
  std::optional<Point<World>> home;
  int clutch_button = -1;  ///< 0 ... 31, the button that is the clutch; any other number: none
};
inline constexpr double kLowestScale = 0.05, kHighestScale = 20;

/// Takes a device's samples to the workspace and forces back: p_World = home + s R (p - middle) + o, where R
/// is the device's axes and the user's yaw, and o is what the clutch has shifted. Forces arrive already
/// multiplied by the gain g, torques by g / s (DeviceParameters), so that the output stage limits what the
/// device really gets. The hand then feels a tissue of stiffness K as s g K (FeltStiffness), and its work is
/// g / s of the work in the patient, for forces as for torques.
class WorkspaceMapping {
 public:
  WorkspaceMapping(const DeviceInfo& info, const WorkspaceSettings& settings);

  /// While the clutch is held the tip rests where it was first seen so, bit for bit; when it is let go the
  /// device goes on from there. A tip that is not a number is passed on as it is, and forgotten.
  /// @param now_ns  on the monotonic clock: the sample's age follows. It is negative for a sample from the
  ///                future, which a driver with another clock takes; beyond a millisecond the output stage
  ///                gives it no force.
  DeviceState to_world(const DeviceSample& sample, std::int64_t now_ns);
  DeviceCommand to_device(const Wrench& wrench) const;
  /// Where the device has to be for its tip to be there; for simulated hands.
  Point<Device> to_device(const Point<World>& tip) const;

 private:
  Rotation<World, Device> R_WorldDevice_;
  double scale_;
  Point<World> home_;  // with what the clutch has shifted
  Point<Device> middle_;
  std::uint32_t clutch_mask_;
  std::optional<Point<World>> held_;  // where the tip rests while the clutch is held
};

/// The state of a device whose samples are places in the patient (DeviceInfo::in_patient).
/// @param X_WorldPatient  where the patient lies as the object is turned
/// @param now_ns          as of WorkspaceMapping::to_world
DeviceState state_in_patient(const DeviceSample& sample, const Transform<World, Patient>& X_WorldPatient,
                             std::int64_t now_ns);

}  // namespace palpate
