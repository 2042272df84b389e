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

/// The name by which a session has it.
inline constexpr const char* kTracker = "tracker";

struct TrackedToolSettings {
  TrackerSettings stream;  ///< no host: nobody said where the tracker is; no transform: nor what is tracked
  Navigation navigation;
};

/// A tracked tool as a device: its tip, in the patient, from a tracker's stream (TrackerStream). A pose and
/// no force: nothing in it could push, so it is no physical device (DeviceInfo::simulated). Pulled.
///
///     stream     |        |        |         poses of the tool's markers, in a thread of the stream's
///     to patient X_PatientTracker X_TrackerTool tip, in the same thread
///     tip        ___/‾‾‾‾‾‾‾‾\______         led on evenly by the servo's thread (LedPose)
///
/// Its pose is stale, and no contact is answered, from LedPose::kHeld_s after the last one that was seen,
/// whether the markers are hidden, the connection is lost or the tip is farther than kMostFromPatient_mm from
/// the points by which the patient was registered: trouble() says which.
///
/// The tool's z axis goes from the tip to the origin of its markers: the shaft, of a straight stylus whose
/// markers are on it. How it is turned about that is not calibrated.
///
/// Not tried on hardware.
class TrackerDriver final : public DeviceDriver {
 public:
  /// A pose farther from the middle of the registered points is of a wrong patient, tool or registration.
  static constexpr double kMostFromPatient_mm = 1000;

  explicit TrackerDriver(const TrackedToolSettings& settings);
  ~TrackerDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable for a server that does not answer, and a tool that is not told of or not seen;
  /// kUsage where nobody said what is tracked.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  // there is nothing to halt
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}
  std::optional<Error> trouble() const override;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// `--device tracker`.
DeviceMaker tracker_maker(const TrackedToolSettings& settings = {});

}  // namespace palpate
