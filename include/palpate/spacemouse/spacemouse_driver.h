#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "palpate/device/device.h"
#include "palpate/device/registry.h"

namespace palpate {

/// Device file and speeds of a SpaceMouse.
struct SpaceMouseSettings {
  std::filesystem::path file;        ///< Device file under /dev/input; empty: the first SpaceMouse found
  std::filesystem::path root = "/";  ///< Root of /dev and /sys, for tests
  double speed_mm_s = 40;            ///< Speed of the tip at full deflection of the cap
  /// Angular velocity at full deflection of the cap.
  double turning_rad_s = 1;
};

/// Driver of a SpaceMouse (3Dconnexion) by kernel events (evdev), with rate control: the deflection of its
/// cap sets the linear and angular velocity of the tip. It provides a pose and buttons but no force, so it
/// does not count as a physical device (DeviceInfo::simulated). Pulled.
///
///     cap       __/‾‾‾‾\___        events, read by a separate thread
///     speed     __/‾‾‾‾\___        dead zone of an eighth of the range, then linear up to the maximum
///     tip       ___/‾‾‾‾‾‾‾        integrated by the servo's thread, clamped to the workspace
///
/// A lost device is a fault; it is searched for ten times a second.
///
/// Not tested on hardware.
class SpaceMouseDriver final : public DeviceDriver {
 public:
  explicit SpaceMouseDriver(const SpaceMouseSettings& settings = {});
  ~SpaceMouseDriver() override;

  std::span<const DeviceInfo> devices() const override;
  /// Errors: kUnavailable if there is none, or if this account has no permission to read it.
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  // no force to halt
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}
  std::optional<Error> failure() const override;

  /// Range of the cap's axes, symmetric about 0.
  static constexpr double kMaxDeflection = 350;
  /// Half edge of the cube to which the tip is clamped.
  static constexpr double kHalfReach_mm = 100;
  /// For devices that send relative events (EV_REL): the cap counts as released after this time without an
  /// event.
  static constexpr double kSilentIsRest_s = 0.1;

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

/// The device option `--device spacemouse`.
DeviceVendor spacemouse_vendor(const SpaceMouseSettings& settings = {});

}  // namespace palpate
