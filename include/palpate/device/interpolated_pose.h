#pragma once

#include <cstdint>

#include "palpate/base/mailbox.h"
#include "palpate/device/device.h"

namespace palpate {

/// Pose that is updated at irregular times, interpolated for the servo's ticks: a viewer's pointer or a
/// tracked tool. No force is returned.
///
///     push()       |        |           |  . . . . . . . . .      20 to 250 updates a second
///     tip          /‾‾‾‾‾‾‾‾\___________|‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾      linear interpolation over the last interval
///     age          0                              |__________/    0 while updated; grows after validity_s
///
/// Between two updates tip and orientation are interpolated, never extrapolated, so that the force has no
/// steps. They lag one interval behind. The first pose, one that follows a pose that has expired, and one
/// that is set down (DeviceSample) apply at once. A pose stays valid for validity_s after an update; then its
/// age grows and the output stage removes the force.
class InterpolatedPose {
 public:
  /// @param tip         initial position, invalid (age unlimited) until the first update
  /// @param validity_s  time for which a pose stays valid after an update
  explicit InterpolatedPose(const Point<Device>& tip, double validity_s = kValidity_s)
      : validity_ns_(static_cast<std::int64_t>(validity_s * 1e9)), from_{tip}, to_{tip} {}

  /// Sets the pose as of `at_ns`. It applies at once if it is `set_down`, also if a later one arrives within
  /// the same tick. A non-finite pose is a bug. Never blocks. Any thread, but only one at a
  /// time; the same holds for release().
  void push(const Point<Device>& tip, const Eigen::Quaterniond& R_DeviceTool, std::int64_t at_ns,
            bool set_down = false) noexcept;
  /// Invalidates the pose: its age is unlimited from the next tick on.
  void release() noexcept;

  /// Writes the interpolated pose at `now_ns` and its sample time. Servo thread only.
  void fill(DeviceSample& sample, std::int64_t now_ns) noexcept;

  /// Default validity of a pose after an update.
  static constexpr double kValidity_s = 0.1;
  /// Speed limit of the interpolation, device mm/s: a distant new position is approached along a path instead
  /// of reached by a jump.
  static constexpr double kMaxSpeed_mm_s = 2000;

 private:
  struct Pose {
    Point<Device> tip;
    Eigen::Quaterniond R_DeviceTool = Eigen::Quaterniond::Identity();
  };
  struct Message {
    Pose pose;
    std::int64_t at_ns = 0;
    bool is_valid = false;
    std::uint32_t set_downs = 0;  // number of poses until then that were set down
  };
  // returns whether the tip is set down in this tick
  bool read_message(std::int64_t now_ns) noexcept;
  Pose pose_at(std::int64_t now_ns) const noexcept;

  const std::int64_t validity_ns_;
  std::uint32_t set_downs_ = 0;  // owned by the updating thread
  Mailbox<Message> messages_;
  // owned by the servo thread: interpolation from one place and time to another
  Pose from_, to_;
  std::int64_t from_ns_ = 0, to_ns_ = 0;
  Message last_;
};

}  // namespace palpate
