#pragma once

#include <cstdint>
#include <unordered_map>

#include "palpate/recording/recording.h"
#include "report/timed_ticks.h"

/// How the loop kept time in a run on the real clock, from what stands in every tick.
namespace palpate::report {

/// Nearest ranks; NaN of nothing.
struct Spread {
  double p50_s, p99_s, p999_s, max_s;
};

/// The spread of those values that are finite, in memory that depends on their range and not on their
/// number: values that differ by less than one part in 4096 count as the largest of them.
class SpreadMeter {
 public:
  void add(double value_s);
  Spread spread() const;

 private:
  struct Bin {
    std::uint64_t count = 0;
    double largest_s = 0;
  };
  std::unordered_map<std::uint64_t, Bin> bins_;  // by the first bits of the number
  std::uint64_t count_ = 0;
};

/// Ticks a second between the first and the last tick, dropped ones included.
class RateOfTicks {
 public:
  void see(const TimedTick& now);
  /// NaN for fewer than two ticks.
  double rate_hz() const;

 private:
  std::uint64_t ticks_ = 0, first_ = 0, last_ = 0;
  double first_s_ = 0, last_s_ = 0;
};

}  // namespace palpate::report
