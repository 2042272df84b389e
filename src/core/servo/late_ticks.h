#pragma once

#include <sys/types.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <thread>

#include "palpate/servo/servo_loop.h"

namespace palpate {

/// Counts late ticks and attributes each to a cause, using the kernel's counters of the ticking thread.
/// Another thread reads these counters every 10 ms, so that the servo makes no system call for it. Late ticks
/// between two readings share the cause of the most delayed one. If a driver ticks in a thread of its own,
/// that thread's counters are read, beginning with the first reading after its first tick.
class LateTicks {
 public:
  LateTicks() = default;
  ~LateTicks() { end(); }
  LateTicks(const LateTicks&) = delete;
  LateTicks& operator=(const LateTicks&) = delete;

  /// @param servo_cpu  CPU that the servo is bound to, which the reading thread keeps off; -1: none
  void begin(int servo_cpu);
  void end();

  // ---- the thread that ticks
  /// Declares the calling thread to be the one that ticks. Called in every tick, because the thread may
  /// change; makes one system call per thread.
  void tick_here() noexcept;
  /// Reports late ticks.
  /// @param late_ns  lateness of the worst of them
  /// @param ticks    number of late ticks
  void add(std::int64_t late_ns, std::uint64_t ticks) noexcept;

  LateCounts counts() const;
  /// Scheduler of the thread that ticked last, as reported by the kernel; empty before the first tick.
  std::string scheduler() const;

 private:
  void find_causes();

  std::atomic<bool> end_{false};
  std::atomic<pid_t> tid_{0};  // thread that ticked last; 0: none
  std::atomic<std::uint64_t> late_{0};
  std::atomic<std::int64_t> worst_ns_{0};
  std::array<std::atomic<std::uint64_t>, 5> by_cause_{};  // indexed by LateCause
  std::thread thread_;
};

}  // namespace palpate
