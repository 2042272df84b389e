#pragma once

#include <cstdint>

#include "palpate/base/latency_histogram.h"
#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/servo/realtime.h"

namespace palpate {

/// Result of measure_empty_loop(): ticks completed and skipped, and the real-time privileges granted.
struct EmptyLoopResult {
  std::uint64_t ticks = 0;
  std::uint64_t skipped = 0;  ///< Grid points that passed without a tick; Pacer::skipped()
  RealtimeGrant grant;
};

/// Measures the machine's own timing as a baseline: runs the servo's Pacer in a dedicated thread with an
/// empty loop body and returns after `seconds`. Errors: kInterrupted if `progress` was stopped; kUnavailable
/// if no thread could be created.
/// @param lateness  receives for every tick the time at which wait() returned minus its scheduled time; may
///                  be read concurrently
Result<EmptyLoopResult> measure_empty_loop(double rate_hz, double seconds, double spin_s,
                                           const RealtimeRequest& request, LatencyHistogram& lateness,
                                           const Progress& progress = {});

}  // namespace palpate
