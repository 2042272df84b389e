#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>

#include "palpate/device/device.h"

namespace palpate {

template <class T>
class Mailbox;

/// A mouse, pen or finger as a device: somebody says from time to time where the tip shall be, and nothing is
/// sent back, because there is nothing that could push. Pulled, at the servo's own rate.
///
///     move()       |        |           |  . . . . . . . . .      60 to 120 a second, at rest 30
///     tip          /‾‾‾‾‾‾‾‾\___________|‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾      a straight line over the last interval
///     age of it    0                              |__________/    0 as long as it is held; then it grows
///
/// Between two messages the tip goes evenly and never beyond what was said, so that the force has no steps.
/// It arrives one interval later; the first one, and one that comes after the pose has grown old, is there at
/// once. A pose holds as long as whoever holds the pointer goes on saying so: after kHeld_s without a word
/// its age grows, and the output stage takes the force away.
class PointerDriver final : public DeviceDriver {
 public:
  /// @param tip  where it rests, held by nobody, until it is moved
  /// @param now  the clock of its ways and samples, which move() asks too; none: CLOCK_MONOTONIC
  explicit PointerDriver(const Point<Device>& tip, TimeSource now = nullptr);
  ~PointerDriver() override;

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

  /// How long a pose holds without another word.
  static constexpr double kHeld_s = 0.1;
  /// The tip goes no faster, of the device: a click elsewhere is a way, and no jump.
  static constexpr double kMostSpeed_mm_s = 2000;

 private:
  struct Message {
    Point<Device> tip;
    std::int64_t at_ns = 0;
    bool held = false;
  };
  void take_message(std::int64_t now_ns);
  Point<Device> tip_at(std::int64_t now_ns) const;

  const TimeSource now_;
  DeviceInfo info_;
  std::unique_ptr<Mailbox<Message>> messages_;
  // the servo thread's: the way of the tip, from where and when to where and when
  Point<Device> from_, to_;
  std::int64_t from_ns_ = 0, to_ns_ = 0;
  Message last_;
};

}  // namespace palpate
