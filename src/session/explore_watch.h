#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <vector>

#include "palpate/base/latency_histogram.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/tissue/nearest.h"

namespace palpate {

/// What the ticks of a session tell: one thread (the recorder's) shows it every tick, others ask. A lock is
/// taken for each tick, which the servo never does.
class ExploreWatch {
 public:
  /// Of the last 0.9 to 1 s before the latest tick.
  struct LastSecond {
    double lateness_p50_us = 0, lateness_p99_us = 0, lateness_max_us = 0;
    double compute_p50_us = 0;
  };

  ExploreWatch(const Model& model, const std::vector<HoldAsked>& asked);
  void see(const TickRecord& record);

  LastSecond last_second() const;
  std::vector<HoldFigure> holds() const;
  /// The largest force sent, of any device.
  double max_force_N() const;
  /// How near a burr came to what is protected, in all ticks.
  std::map<LabelId, double> nearest_mm() const;

 private:
  // a tenth of a second of ticks
  struct Part {
    std::uint64_t tenth = 0;
    LatencyHistogram lateness, compute;
  };
  static constexpr std::size_t kParts = 10;

  mutable std::mutex mutex_;
  std::vector<HoldMeter> meters_;
  NearestMeter nearest_;
  double max_force_N_ = 0;
  std::array<Part, kParts> parts_;  // a ring: the tenth t is part t % kParts
  std::uint64_t tenth_ = 0;         // of the latest tick
};

}  // namespace palpate
