#pragma once

#include <sys/types.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <thread>

#include "palpate/servo/servo_loop.h"

namespace palpate {

/// Counts ticks that were not on time, and finds out why from what the kernel counts about their thread. The
/// looking is done on another thread, every hundredth of a second, so that the servo makes no system call for
/// it; several late ticks between two looks share the cause of the worst. Where a driver ticks in a thread of
/// its own it is that thread whose counts are looked at, from the look after its first tick on.
class LateTicks {
 public:
  LateTicks() = default;
  ~LateTicks() { end(); }
  LateTicks(const LateTicks&) = delete;
  LateTicks& operator=(const LateTicks&) = delete;

  /// @param servo_cpu  the CPU that the servo is bound to, -1: none; the looking is done elsewhere
  void begin(int servo_cpu);
  void end();

  // ---- the thread that ticks
  /// It is this one. In every tick: another thread may follow. Asks the system once in a thread's life.
  void tick_here() noexcept;
  void add(std::int64_t late_ns, std::uint64_t ticks) noexcept;

  LateCounts counts() const;
  /// What scheduling the thread that ticked last has, as the system says it; empty before the first tick.
  std::string scheduler() const;

 private:
  void look_for_causes();

  std::atomic<bool> end_{false};
  std::atomic<pid_t> tid_{0};  // of the thread that ticked last, 0: none
  std::atomic<std::uint64_t> late_{0};
  std::atomic<std::int64_t> worst_ns_{0};
  std::array<std::atomic<std::uint64_t>, 5> by_cause_{};  // LateCause
  std::thread thread_;
};

}  // namespace palpate
