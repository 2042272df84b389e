#pragma once

#include <atomic>
#include <cstdint>

#include "base/latency_histogram.h"
#include "servo/realtime.h"

namespace palpate {

/// What a loop with nothing in it achieved.
struct BareLoop {
  std::uint64_t ticks = 0;
  std::uint64_t skipped = 0;  ///< Pacer::skipped()
  RealtimeGrant grant;
};

/// What the machine itself can do, for comparison: the servo's Pacer in a thread of its own, and nothing else
/// in the loop. Returns after `seconds` or when `stop` becomes true.
/// @param lateness  gets, for every tick, the time right after wait() less the time it was scheduled for;
///                  may be read meanwhile
BareLoop run_bare_loop(double rate_hz, double seconds, double spin_s, const RealtimeRequest& request,
                       const std::atomic<bool>& stop, LatencyHistogram& lateness);

}  // namespace palpate
