#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"
#include "palpate/device/vendor_library.h"

namespace palpate {

/// Library, devices and weight compensation of OpenHaptics.
struct OpenHapticsSettings {
  VendorLibraryLocation library{{}, {"libHD.so", "libHD.so.3.4", "libHD.so.3.0"}, {}};
  /// Names of the devices in the vendor's configuration. Empty: one device, under the usual names of the
  /// default one.
  std::vector<std::string> names;
  /// Mass attached to the end effector, kg: the driver compensates its weight, and the devices' force limits
  /// are reduced accordingly. Empty: no compensation.
  std::optional<double> held_mass_kg;
};

/// Driver of Touch, Touch X and Phantom Premium through the HDAPI of OpenHaptics, which is located when
/// open() is called. The vendor's scheduler calls the servo in its own thread, inside its frame
/// (DeviceInfo::Drive::kCallback): the command for a state is set in the same frame.
///
///     vendor's thread   |frame|frame|frame|frame                        |zeros|frame|frame
///     run()                                 ╳ ticks with `fault` until a frame has ended
///     finder                                  stop, disable, init, …  ──┘
///
/// Exactly one of the first two threads calls the servo. **Fault handling**: the force is removed first.
/// Samples are marked `fault`, frames carry zeros whatever the servo returns, and failure() then describes
/// the fault. A lost device, or one whose scheduler has stalled, is disabled and reinitialised by a separate
/// thread, ten times a second.
///
/// Not tested on hardware: written from public source code and documentation.
class OpenHapticsDriver final : public DeviceDriver {
 public:
  explicit OpenHapticsDriver(const OpenHapticsSettings& settings = {});
  ~OpenHapticsDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable if there is no library, device or licence, or if the library's safety limits cannot
  /// be enabled; kUsage if the attached mass is too heavy for the device.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  std::optional<Error> failure() const override;

  /// Time without a completed frame after which the motors are disabled and run() ticks, and after which the
  /// scheduler is given up.
  static constexpr double kLate_s = 0.008, kAbandoned_s = 0.1;
  /// Duration for which warm motors or an exceeded force or speed count as a fault.
  static constexpr double kCalm_s = 1;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// The device option `--device touch`.
DeviceVendor openhaptics_vendor(const OpenHapticsSettings& settings = {});

}  // namespace palpate
