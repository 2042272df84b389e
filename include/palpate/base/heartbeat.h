#pragma once

#include <atomic>
#include <cstdint>
#include <limits>

namespace palpate {

/// Shared memory between a servo loop and the supervisor process that monitors it, so that neither waits for
/// the other. All times are CLOCK_MONOTONIC in nanoseconds, which the processes of one machine share.
///
/// Halts are numbered by an increasing counter that continues from one supervisor of a device to the next.
/// Ending a halt names its number, and the device obeys the newest halt: a late end of an older halt does not
/// end a newer one.
struct Heartbeat {
  static constexpr std::int64_t kResting = 0;
  /// Halt number that is never ended, for a supervisor that will not be there to end it.
  static constexpr std::uint64_t kPermanentHalt = std::numeric_limits<std::uint64_t>::max();

  // ---- written by the process that runs the loop
  std::atomic<std::int64_t> beat_ns{kResting};      ///< End of the last tick; ns. kResting: no tick is due.
  std::atomic<std::int64_t> checked_ns{kResting};   ///< Last check by the loop's own watchdog; ns.
  std::atomic<std::uint64_t> newest_ended_halt{0};  ///< Number of the newest halt that has ended.

  // ---- written by the supervisor
  /// Number of the newest halt, which is in force until newest_ended_halt reaches it.
  std::atomic<std::uint64_t> newest_halt{0};
};

static_assert(std::atomic<std::int64_t>::is_always_lock_free);
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

}  // namespace palpate
