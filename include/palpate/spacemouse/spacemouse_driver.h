#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"

namespace palpate {

struct SpaceMouseSettings {
  std::filesystem::path file;        ///< under /dev/input; empty: the first one that is such a device
  std::filesystem::path root = "/";  ///< where /dev and /sys are, for tests
  double speed_mm_s = 40;            ///< of the tip, at the end of the cap's way
  double turning_rad_s = 1;
};

/// A SpaceMouse (3Dconnexion), by the kernel's events (evdev): its cap is pushed and turned, and the tip
/// moves and turns that fast. A pose and buttons, and no force: nothing in it could push, so it is no
/// physical device (DeviceInfo::simulated). Pulled.
///
///     cap       __/‾‾‾‾\___        events, read by a thread of its own
///     speed     __/‾‾‾‾\___        an eighth of the way does nothing; then evenly up to the most
///     tip       ___/‾‾‾‾‾‾‾        added up by the servo's thread, within the workspace
///
/// Lost, it is a fault, and looked for ten times a second.
///
/// Not tried on hardware.
class SpaceMouseDriver final : public DeviceDriver {
 public:
  explicit SpaceMouseDriver(const SpaceMouseSettings& settings = {});
  ~SpaceMouseDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable where there is none or this account may not read it.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  // there is nothing to halt
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}
  std::optional<Error> trouble() const override;

  /// What the cap's axes go to, either way.
  static constexpr double kMaxDeflection = 350;
  /// Half an edge of the cube that the tip stays in.
  static constexpr double kHalfReach_mm = 100;
  /// Of one that tells changes of place (EV_REL) the cap is at rest when it has said nothing for so long.
  static constexpr double kSilentIsRest_s = 0.1;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// `--device spacemouse`.
DeviceVendor spacemouse_maker(const SpaceMouseSettings& settings = {});

}  // namespace palpate
