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

struct ForceDimensionSettings {
  /// libdrd, which holds libdhd's functions, too, comes first: it knows whether an arm is initialised.
  VendorLibraryPlace library{{}, {"libdrd.so.3", "libdrd.so", "libdhd.so.3", "libdhd.so"}, {}};
  bool gravity = true;  ///< the library carries the arm's own weight
  /// Of what is held at the arm's end, kg, where that is not the maker's own; counts with gravity.
  std::optional<double> held_mass_kg;
};

/// Devices of Force Dimension's (omega, sigma, delta) and Novint's Falcon, through the maker's library, which
/// is found when open() is called. Pulled: the loop's own thread reads and writes. All that are connected at
/// open() are devices of the driver, kMaxDevices at most.
///
/// **A fault** takes the force first: the samples say `fault`, zeros are written whatever the servo answers,
/// and then trouble() says what it is. A device that is lost is closed, looked for and opened again by a
/// thread of its own, ten times a second; the session goes on meanwhile.
///
/// **Who moves**: an arm that is not initialised moves by itself when it is (drdAutoInit): open() does that
/// with consent alone, and never later. A Falcon is initialised by hand, while the session waits.
///
/// Not tried on hardware: written from public source and documentation.
class ForceDimensionDriver final : public DeviceDriver {
 public:
  explicit ForceDimensionDriver(const ForceDimensionSettings& settings = {});
  ~ForceDimensionDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable where there is no library, no device, or one that may not be used; kUsage where an
  /// arm would move without consent.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  std::optional<Error> trouble() const override;

  /// How often what the device says of itself is read.
  static constexpr double kStatusEvery_s = 0.004;
  /// How long calls may fail until the device is lost.
  static constexpr double kGivenUp_s = 0.05;
  /// Forces that the device has switched off by itself (too fast, or nobody spoke to it) come back after so
  /// long, where the tip is slower than kCalm_mm_s.
  static constexpr double kCalm_s = 1, kCalm_mm_s = 50;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// `--device force-dimension`.
DeviceVendor force_dimension_maker(const ForceDimensionSettings& settings = {});

}  // namespace palpate
