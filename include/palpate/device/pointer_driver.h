#pragma once

#include <array>
#include <span>

#include "palpate/device/device.h"
#include "palpate/device/interpolated_pose.h"

namespace palpate {

/// A mouse, pen or finger as a device (InterpolatedPose). Positions arrive 60 to 120 times a second, at rest
/// 30 times. The device exerts no force. Pulled, at the servo's own rate.
///
/// A position may be a point on a surface, with a direction and a force to press with. The driver then moves
/// the tip along that direction, in every tick, until the rendered force has the requested magnitude:
/// integral control of the depth, whose rate is proportional to the error of the force.
///
///     depth rate = kPressGain_mm_per_N_s * (force_N - |rendered force|)        limited to
///     kMaxPressSpeed_mm_s
///
/// The force is therefore independent of the tissue's stiffness, of the page's frame rate, and of deviations
/// of the page's surface from the rendered one.
class PointerDriver final : public DeviceDriver {
 public:
  /// Force to press with.
  struct Press {
    Vector<Device> into;  ///< Unit direction, into the surface
    double force_N = 0;   ///< Magnitude of the rendered force, N; 0: no press, the tip is at the position
  };

  /// @param tip  initial position, invalid until the first move()
  /// @param now  clock for interpolation and sample times, also used by move(); nullptr: CLOCK_MONOTONIC
  explicit PointerDriver(const Point<Device>& tip, TimeSource now = nullptr);

  /// Sets the position, and the force to press with from there, as of now. Never blocks. Any thread, but only
  /// one at a time; the same holds for release(). Errors: kBadInput if the position or the press is not
  /// finite; the earlier ones then stay.
  /// @param set_down  the tip is at the position at once, without a path to it, and its contact is reset
  Result<void> move(const Point<Device>& tip) { return move(tip, {}); }
  Result<void> move(const Point<Device>& tip, const Press& press, bool set_down = false);
  /// Invalidates the position: its age is unlimited from the next tick on.
  void release() noexcept;

  /// Simulated, because it has no mechanism. Has no force limit, stiffness limit or position step.
  static DeviceInfo info();
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  // no force to halt
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

  /// Validity of a position after move(). Longer than a page's main thread is blocked by its drawing; the
  /// rendered force has faded out 0.6 s after the last message.
  static constexpr double kValidity_s = 0.55;
  /// Gain of the force control: stable up to a rendered stiffness of 16 N/mm at 1000 ticks a second.
  static constexpr double kPressGain_mm_per_N_s = 100;
  static constexpr double kMaxPressSpeed_mm_s = 100;
  /// Range of the depth of the tip below the position, device mm. Negative values compensate for a position
  /// below the rendered surface.
  static constexpr double kMinDepth_mm = -3, kMaxDepth_mm = 15;
  /// Maximum depth while the rendered force is less than kMinForceFraction of the requested one:
  /// either there is no surface, or the force is withheld; from a greater depth a withheld force would return
  /// in a larger step.
  static constexpr double kMaxSearchDepth_mm = 1.5, kMinForceFraction = 0.1;

 private:
  // moves the tip of the sample into the surface, for the force that the previous tick has rendered
  void press(DeviceSample& sample, double rendered_N, double dt_s) noexcept;

  const TimeSource now_;
  const DeviceInfo info_;
  InterpolatedPose reported_;
  Mailbox<Press> presses_;
  // owned by the servo thread
  std::array<DeviceCommand, 1> commands_{};  // commands of the last tick
  std::int64_t last_tick_ns_ = 0;            // time of the last tick
  Press requested_;
  Vector<Device> into_;  // direction of the press, smoothed
  double depth_mm_ = 0;
};

}  // namespace palpate
