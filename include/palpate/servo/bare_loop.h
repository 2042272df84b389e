#pragma once

#include <cstdint>

#include "palpate/base/latency_histogram.h"
#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/servo/realtime.h"

namespace palpate {

/// What a loop with nothing in it achieved.
struct BareLoop {
  std::uint64_t ticks = 0;
  std::uint64_t skipped = 0;  ///< Pacer::skipped()
  RealtimeGrant grant;
};

/// What the machine itself can do, for comparison: the servo's Pacer in a thread of its own, and nothing else
/// in the loop. Returns after `seconds`. Errors: kInterrupted; kUnavailable when there is no thread to be
/// had.
/// @param lateness  gets, for every tick, the time right after wait() less the time it was scheduled for;
///                  may be read meanwhile
Result<BareLoop> run_bare_loop(double rate_hz, double seconds, double spin_s, const RealtimeRequest& request,
                               LatencyHistogram& lateness, const Progress& progress = {});

}  // namespace palpate
