#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"
#include "palpate/device/vendor_library.h"

namespace palpate {

struct OpenHapticsSettings {
  VendorLibraryPlace library{{}, {"libHD.so", "libHD.so.3.4", "libHD.so.3.0"}, {}};
  /// Names under which the maker's own setup knows the devices. Empty: one device, the default one, by the
  /// names that it is known to have.
  std::vector<std::string> names;
  /// Of what is held at the arm's end, kg: the driver pushes up against its weight, and the devices' limits
  /// are that much less. Empty: it does not.
  std::optional<double> held_mass_kg;
};

/// Touch, Touch X and Phantom Premium, through the HDAPI of OpenHaptics, which is found when open() is
/// called. The maker's scheduler calls the servo in a thread of its own, inside its frame
/// (DeviceInfo::Drive::kCallback): the state of a frame is answered in that frame.
///
///     vendor's thread   |frame|frame|frame|frame                        |zeros|frame|frame
///     run()                                 ╳ ticks with `fault` until a frame has ended
///     finder                                  stop, disable, init, …  ──┘
///
/// Exactly one of the first two threads calls the servo. **A fault** takes the force first: the samples say
/// `fault`, frames carry zeros whatever the servo answers, and then trouble() says what it is. A device that
/// is lost, or whose scheduler stands still, is disabled and begun anew by a thread of its own, ten times a
/// second.
///
/// Not tried on hardware: written from public source and documentation.
class OpenHapticsDriver final : public DeviceDriver {
 public:
  explicit OpenHapticsDriver(const OpenHapticsSettings& settings = {});
  ~OpenHapticsDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable where there is no library, no device, no licence, or a device without its library's
  /// guards; kUsage where what is held is too heavy for it.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  std::optional<Error> trouble() const override;

  /// Since when no frame has ended: the motors are switched off, and run() ticks; the scheduler is given up.
  static constexpr double kLate_s = 0.008, kGivenUp_s = 0.1;
  /// How long motors that are warm, a force or a speed that was too high is a fault.
  static constexpr double kCalm_s = 1;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// `--device touch`.
DeviceVendor openhaptics_maker(const OpenHapticsSettings& settings = {});

}  // namespace palpate
