#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"
#include "palpate/navigation/navigated_tip.h"
#include "palpate/tracker/tracker_stream.h"

namespace palpate {

/// Device name in a session.
inline constexpr const char* kTracker = "tracker";

/// Settings of TrackerDriver.
struct TrackedToolSettings {
  TrackerSettings stream;  ///< Without host or transform: not configured
  Navigation navigation;
};

/// Tracked tool as a device: its tip in the patient frame, from a tracker's stream (TrackerStream). It has a
/// pose but no actuators, so it does not count as a physical device (DeviceInfo::simulated). The servo pulls
/// its state.
///
///    stream     |        |        |         poses of the tool's markers, on the stream's thread
///    to patient X_PatientTracker X_TrackerTool tip, on the same thread
///    tip        ___/‾‾‾‾‾‾‾‾\______         interpolated on the servo's thread (InterpolatedPose)
///
/// The pose is stale, and contact is not rendered, from InterpolatedPose::kValidity_s after the last valid
/// pose on, if the markers are hidden, the connection is lost or the tip is farther than kMaxFromPatient_mm
/// from the registration's points; failure() gives the reason.
///
/// The tool's z axis points from the tip to the origin of its markers: the shaft of a straight stylus with
/// the markers on it. Rotation about that axis is not calibrated.
///
/// Not tested on hardware.
class TrackerDriver final : public DeviceDriver {
 public:
  /// Plausibility limit: a pose farther from the centre of the registered points indicates a wrong patient,
  /// tool or registration.
  static constexpr double kMaxFromPatient_mm = 1000;

  explicit TrackerDriver(const TrackedToolSettings& settings);
  ~TrackerDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable if the server does not answer, or the tool is not reported or not seen; kUsage if
  /// no transform is configured.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  // no force to be halted
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}
  std::optional<Error> failure() const override;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// Factory for `--device tracker`.
DeviceVendor tracker_vendor(const TrackedToolSettings& settings = {});

}  // namespace palpate
