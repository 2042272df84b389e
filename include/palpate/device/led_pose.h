#pragma once

#include <cstdint>

#include "palpate/base/mailbox.h"
#include "palpate/device/device.h"

namespace palpate {

/// A pose that somebody tells from time to time, as the servo's ticks take it: a viewer's pointer, a tracked
/// tool. Nothing is sent back.
///
///     tell()       |        |           |  . . . . . . . . .      20 to 250 a second
///     tip          /‾‾‾‾‾‾‾‾\___________|‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾      a straight line over the last interval
///     age of it    0                              |__________/    0 as long as it is held; then it grows
///
/// Between two messages the tip goes evenly and never beyond what was said, so that the force has no steps;
/// so does the orientation. It arrives one interval later; the first one, and one that comes after the pose
/// has grown old, is there at once. A pose holds as long as it is told again: after kHeld_s without a word
/// its age grows, and the output stage takes the force away.
class LedPose {
 public:
  /// @param tip  where it rests, held by nobody, until something is told
  explicit LedPose(const Point<Device>& tip) : from_{tip}, to_{tip} {}

  /// It is there as of `at_ns`; what is no number is a bug. Never waits. Any thread, one at a time, as for
  /// let_go().
  void tell(const Point<Device>& tip, const Eigen::Quaterniond& R_DeviceTool, std::int64_t at_ns) noexcept;
  /// Nobody holds it: its pose is old at once.
  void let_go() noexcept;

  /// The servo's thread: where it is now, and when that was true.
  void fill(DeviceSample& sample, std::int64_t now_ns) noexcept;

  /// How long a pose holds without another word.
  static constexpr double kHeld_s = 0.1;
  /// The tip goes no faster, of the device: a click elsewhere is a way, and no jump.
  static constexpr double kMostSpeed_mm_s = 2000;

 private:
  struct Place {
    Point<Device> tip;
    Eigen::Quaterniond R_DeviceTool = Eigen::Quaterniond::Identity();
  };
  struct Message {
    Place place;
    std::int64_t at_ns = 0;
    bool held = false;
  };
  void take_message(std::int64_t now_ns) noexcept;
  Place place_at(std::int64_t now_ns) const noexcept;

  Mailbox<Message> messages_;
  // the servo thread's: the way, from where and when to where and when
  Place from_, to_;
  std::int64_t from_ns_ = 0, to_ns_ = 0;
  Message last_;
};

}  // namespace palpate
