#pragma once

#include <span>

#include "palpate/device/device.h"
#include "palpate/device/led_pose.h"

namespace palpate {

/// A mouse, pen or finger as a device: somebody says from time to time where the tip shall be (LedPose), 60
/// to 120 times a second and at rest 30, and nothing is sent back, because there is nothing that could push.
/// Pulled, at the servo's own rate.
class PointerDriver final : public DeviceDriver {
 public:
  /// @param tip  where it rests, held by nobody, until it is moved
  /// @param now  the clock of its ways and samples, which move() asks too; none: CLOCK_MONOTONIC
  explicit PointerDriver(const Point<Device>& tip, TimeSource now = nullptr);

  /// The pointer is there as of now; one that is no number is a bug. Never waits. Any thread, one at a time,
  /// as for release().
  void move(const Point<Device>& tip) noexcept;
  /// Nobody holds it: its pose is old at once.
  void release() noexcept;

  /// Simulated: nothing can move. Neither its force nor its stiffness has a limit of its own, and its steps
  /// are not known.
  static DeviceInfo info();
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  // there is nothing to halt
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

 private:
  const TimeSource now_;
  const DeviceInfo info_;
  LedPose told_;
};

}  // namespace palpate
