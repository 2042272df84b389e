#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "palpate/device/telemetry.h"
#include "palpate/server/viewer_host.h"
#include "ros2/samples.h"

namespace palpate::ros2 {

/// Converts ticks to samples.
class Sampler {
 public:
  explicit Sampler(const ViewedScene& scene);
  /// Converts device `device` of a tick; false if it has no finite pose yet.
  bool convert(const TickRecord& tick, std::size_t device, HandSample& sample) const;

 private:
  const ViewedScene& scene_;
};

/// Pose of the patient's frame in the base frame.
PoseSample patient_in_base();

/// Structures with their labels, as JSON: {"structures": [{"label": 1, "name": "femur"}, ...]}.
std::string scene_text(const ViewedScene& scene);

/// Estimates the system's time of a tick from the time at which it was read. Of the differences between both
/// clocks, which contain the age of the tick read, the smallest recent one is taken, so that stamps are as
/// regular as ticks.
class TickClock {
 public:
  /// Time of a tick since 1970; ns.
  std::int64_t stamp_ns(double tick_time_s, std::int64_t now_ns);

 private:
  std::int64_t offset_ns_ = 0, last_tick_ns_ = -1;
};

}  // namespace palpate::ros2
