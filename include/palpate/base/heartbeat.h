#pragma once

#include <atomic>
#include <cstdint>
#include <limits>

namespace palpate {

/// What a servo loop tells another process of itself, and what that process answers: in memory that both
/// share, so that neither waits for the other. All times are CLOCK_MONOTONIC, which the processes of one
/// machine have in common.
///
/// Halts have numbers that only grow, from one supervisor of a device to the next, too. Whoever ends one says
/// its number, and a device obeys the newest: an end that it hears of late ends no halt that came meanwhile.
struct Heartbeat {
  static constexpr std::int64_t kResting = 0;
  /// The number of a halt that nothing ends, for who will not be there to end it.
  static constexpr std::uint64_t kHaltForGood = std::numeric_limits<std::uint64_t>::max();

  // ---- written by the process with the loop
  std::atomic<std::int64_t> beat_ns{kResting};     ///< end of the last tick; kResting: no tick is due
  std::atomic<std::int64_t> looked_ns{kResting};   ///< when the loop's own watchdog looked last
  std::atomic<std::uint64_t> halts_that_ended{0};  ///< number of the newest halt that has ended

  // ---- written by the supervisor
  /// Number of the newest halt, which lasts until halts_that_ended has the same.
  std::atomic<std::uint64_t> halts{0};
};

static_assert(std::atomic<std::int64_t>::is_always_lock_free);
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

}  // namespace palpate
