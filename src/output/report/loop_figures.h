#pragma once

#include <cstdint>
#include <unordered_map>

#include "palpate/recording/recording.h"
#include "report/timed_ticks.h"

/// Timing statistics of a loop on the real clock, computed from its ticks.
namespace palpate::report {

/// Percentiles by the nearest-rank method; NaN without values.
struct Spread {
  double p50_s, p99_s, p999_s, max_s;
};

/// Distribution of the finite values. Memory depends on their range and not on their number: values that
/// differ by less than one part in 4096 share a bin and count as the largest in it.
class SpreadMeter {
 public:
  void add(double value_s);
  Spread spread() const;

 private:
  struct Bin {
    std::uint64_t count = 0;
    double largest_s = 0;
  };
  std::unordered_map<std::uint64_t, Bin> bins_;  // key: leading bits of the value
  std::uint64_t count_ = 0;
};

/// Mean tick rate between the first and the last tick, including dropped ticks.
class TickRateMeter {
 public:
  void observe(const TimedTick& now);
  /// NaN if there are fewer than two ticks.
  double rate_hz() const;

 private:
  std::uint64_t ticks_ = 0, first_ = 0, last_ = 0;
  double first_s_ = 0, last_s_ = 0;
};

}  // namespace palpate::report
