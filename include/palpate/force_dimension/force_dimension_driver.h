#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"
#include "palpate/device/vendor_library.h"

namespace palpate {

/// Library and gravity compensation of Force Dimension's devices.
struct ForceDimensionSettings {
  /// libdrd is preferred: it contains libdhd's functions and additionally reports whether an arm is
  /// initialised.
  VendorLibraryLocation library{{}, {"libdrd.so.3", "libdrd.so", "libdhd.so.3", "libdhd.so"}, {}};
  bool gravity = true;  ///< Whether the library compensates the arm's weight
  /// Mass attached to the end effector, kg, if different from the vendor's; used for gravity compensation.
  std::optional<double> held_mass_kg;
};

/// Driver of Force Dimension's devices (omega, sigma, delta) and Novint's Falcon through the vendor's
/// library, which is located when open() is called. Pulled: the loop's own thread reads and writes. All
/// devices connected at open() are devices of the driver, at most kMaxDevices.
///
/// **Fault handling**: the force is removed first. Samples are marked `fault`, zeros are written whatever the
/// servo returns, and failure() then describes the fault. A lost device is closed, searched for and reopened
/// by a separate thread ten times a second, while the session continues.
///
/// **Autonomous motion**: initialising an arm (drdAutoInit) moves it. open() does that only with consent, and
/// it never happens later. A Falcon is initialised manually while the session waits.
///
/// Not tested on hardware: written from public source code and documentation.
class ForceDimensionDriver final : public DeviceDriver {
 public:
  explicit ForceDimensionDriver(const ForceDimensionSettings& settings = {});
  ~ForceDimensionDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable if there is no library or no device, or one without permission; kUsage if an arm
  /// would move without consent.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  std::optional<Error> failure() const override;

  /// Interval at which the device's status is read.
  static constexpr double kStatusEvery_s = 0.004;
  /// Duration of failing calls after which the device counts as lost.
  static constexpr double kAbandoned_s = 0.05;
  /// Forces that the device has disabled by itself (excessive speed, or its watchdog) are enabled again after
  /// this time with the tip slower than kCalm_mm_s.
  static constexpr double kCalm_s = 1, kCalm_mm_s = 50;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// The device option `--device force-dimension`.
DeviceVendor force_dimension_vendor(const ForceDimensionSettings& settings = {});

}  // namespace palpate
