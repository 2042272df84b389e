#pragma once

#include <atomic>
#include <cstdint>

namespace palpate {

/// What a servo loop tells another process of itself, and what that process answers: in memory that both
/// share, so that neither waits for the other. All times are CLOCK_MONOTONIC, which the processes of one
/// machine have in common.
struct Heartbeat {
  static constexpr std::int64_t kResting = 0;

  // ---- written by the process with the loop
  std::atomic<std::int64_t> beat_ns{kResting};     ///< end of the last tick; kResting: no tick is due
  std::atomic<std::int64_t> looked_ns{kResting};   ///< when the loop's own watchdog looked last
  std::atomic<std::uint32_t> halts_that_ended{0};  ///< of `halts`, how many the loop has let go of

  // ---- written by the supervisor
  std::atomic<std::uint32_t> halts{0};  ///< how often it has told the devices to give no force
};

static_assert(std::atomic<std::int64_t>::is_always_lock_free);

}  // namespace palpate
