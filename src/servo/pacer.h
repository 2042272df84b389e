#pragma once

#include <atomic>
#include <cstdint>

namespace palpate {

/// The clock of a loop that runs in a thread of our own: ticks on an absolute grid of time. wait() sleeps
/// until `spin` before the next point of the grid and busy-waits up to it.
///
///      grid      |1      |2      |3      |4      |5      |6
///      tick      [t1]    [t2...........stall.....] [t6]      3, 4 and 5 are skipped, t6 is on the grid again
///
/// Point k lies at the start plus k periods, computed anew for every k: a period that is no whole number of
/// nanoseconds does not add up to a drift. wait() makes no other system call than its sleep.
class Pacer {
 public:
  /// @param rate_hz  above 0
  /// @param spin_s   0 or more; 0: only sleep. At most 0.8 of a period is used, so that a short tick leaves
  ///                 time to sleep: a SCHED_FIFO thread that never does starves the others on its CPU, and
  ///                 the kernel holds it back for 50 ms in every second (sched_rt_runtime_us)
  /// @param stop     outlives the pacer; noticed within a period
  Pacer(double rate_hz, double spin_s, const std::atomic<bool>& stop);

  /// Returns at the next point of the grid, or later where the machine is late; false: stop was asked. The
  /// first call starts the grid, its first point one period from then.
  bool wait() noexcept;

  /// The point of the grid that the last wait() was for, of monotonic_ns().
  std::int64_t scheduled_ns() const { return scheduled_ns_; }
  /// Rounded to whole nanoseconds.
  std::int64_t period_ns() const;
  /// Points of the grid which passed while a tick was still running or the thread did not run. They are not
  /// made up for: the next tick is the next point that still lies ahead.
  std::uint64_t skipped() const { return skipped_; }
  bool stopped() const noexcept { return stop_.load(std::memory_order_relaxed); }

 private:
  std::int64_t grid_ns(std::int64_t point) const;
  void sleep_until(std::int64_t time_ns) const noexcept;

  const double period_ns_;
  const std::int64_t spin_ns_;
  const std::atomic<bool>& stop_;
  bool started_ = false;
  std::int64_t start_ns_ = 0, scheduled_ns_ = 0;
  std::int64_t point_ = 0;
  std::uint64_t skipped_ = 0;
};

}  // namespace palpate
