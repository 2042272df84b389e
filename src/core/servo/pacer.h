#pragma once

#include <atomic>
#include <cstdint>

namespace palpate {

/// Clock of a loop that runs in a thread of this process: ticks on an absolute time grid. wait() sleeps until
/// `spin_s` before the next grid point and busy-waits for the rest.
///
///      grid      |1      |2      |3      |4      |5      |6
///      tick      [t1]    [t2...........stall.....] [t6]      3, 4 and 5 are skipped, t6 is on the grid again
///
/// Point k lies at the start plus k periods and is computed directly for every k, so that a period that is
/// not a whole number of nanoseconds causes no drift. wait() makes no system call other than its sleep.
class Pacer {
 public:
  /// @param rate_hz  tick rate, above 0
  /// @param spin_s   busy-wait time, 0 or more; 0: only sleep. Limited to 0.8 of a period, so that a short
  ///                 tick leaves time to sleep: a SCHED_FIFO thread that never sleeps starves the others on
  ///                 its CPU, and the kernel throttles it for 50 ms in every second (sched_rt_runtime_us)
  /// @param stop     must outlive the pacer; noticed within a period
  Pacer(double rate_hz, double spin_s, const std::atomic<bool>& stop);

  /// Returns at the next grid point, or later if the machine is late. Returns false if a stop was requested.
  /// The first call starts the grid; its first point lies one period later.
  bool wait() noexcept;

  /// Grid point of the last wait(), on the clock of monotonic_ns().
  std::int64_t scheduled_ns() const { return scheduled_ns_; }
  /// Period, rounded to whole nanoseconds.
  std::int64_t period_ns() const;
  /// Number of grid points that passed while a tick was still running or the thread was not scheduled. They
  /// are not made up for: the next tick is at the first grid point in the future.
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
