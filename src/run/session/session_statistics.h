#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <vector>

#include "palpate/base/latency_histogram.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/tissue/protected_distance.h"

namespace palpate {

/// Figures of a session, computed from its ticks: one thread (the recorder's) adds every tick, others query.
/// Each tick takes a lock, which the servo never does.
class SessionStatistics {
 public:
  /// Figures over the last 0.9 to 1 s before the latest tick.
  struct LastSecond {
    double lateness_p50_us = 0, lateness_p99_us = 0, lateness_max_us = 0;
    double compute_p50_us = 0;
  };

  SessionStatistics(const Model& model, const std::vector<HoldRequest>& holds);
  void observe(const TickRecord& record);

  LastSecond last_second() const;
  std::vector<HoldFigure> holds() const;
  /// Largest commanded force of any device.
  double max_force_N() const;
  /// Smallest distance between a burr and each protected structure over all ticks.
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
  ProtectedDistanceMeter nearest_;
  double max_force_N_ = 0;
  std::array<Part, kParts> parts_;  // a ring: the tenth t is part t % kParts
  std::uint64_t tenth_ = 0;         // tenth of the latest tick
};

}  // namespace palpate
