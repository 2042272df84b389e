#pragma once

#include <span>

#include "palpate/device/device.h"
#include "palpate/device/interpolated_pose.h"

namespace palpate {

/// A mouse, pen or finger as a device (InterpolatedPose). Positions arrive 60 to 120 times a second, at rest
/// 30 times. The device exerts no force. Pulled, at the servo's own rate.
class PointerDriver final : public DeviceDriver {
 public:
  /// @param tip  initial position, invalid until the first move()
  /// @param now  clock for interpolation and sample times, also used by move(); nullptr: CLOCK_MONOTONIC
  explicit PointerDriver(const Point<Device>& tip, TimeSource now = nullptr);

  /// Sets the position as of now. A non-finite position is a bug. Never blocks. Any thread, but only one at a
  /// time; the same holds for release().
  void move(const Point<Device>& tip) noexcept;
  /// Invalidates the position: its age is unlimited from the next tick on.
  void release() noexcept;

  /// Simulated, because nothing moves. States neither a force limit, a stiffness limit nor a position step.
  static DeviceInfo info();
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  // no force to halt
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

 private:
  const TimeSource now_;
  const DeviceInfo info_;
  InterpolatedPose told_;
};

}  // namespace palpate
