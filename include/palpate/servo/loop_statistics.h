#pragma once

#include "palpate/base/latency_histogram.h"
#include "palpate/servo/servo_loop.h"

/// Arithmetic on the timing statistics of a loop.
namespace palpate {

/// Percentiles of a histogram, us.
inline Percentiles percentiles_of(const LatencyHistogram& histogram) {
  const LatencyHistogram::Summary s = histogram.summary();
  return {s.p50_us, s.p99_us, s.p999_us, s.max_us};
}

inline LateCounts operator-(const LateCounts& a, const LateCounts& b) {
  return {a.steal - b.steal, a.page_fault - b.page_fault, a.preemption - b.preemption,
          a.run_queue - b.run_queue, a.unknown - b.unknown};
}

inline LateCounts operator+(const LateCounts& a, const LateCounts& b) {
  return {a.steal + b.steal, a.page_fault + b.page_fault, a.preemption + b.preemption,
          a.run_queue + b.run_queue, a.unknown + b.unknown};
}

}  // namespace palpate
