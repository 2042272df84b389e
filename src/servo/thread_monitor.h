#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Why a tick was late, seen from outside: another thread reads what the kernel counts about the servo's
/// thread, so that the servo itself makes no system call for it.
namespace palpate {

class ThreadMonitor {
 public:
  /// What the kernel has counted about a thread since it began. Empty where the kernel does not say (no
  /// schedstat, a container that hides /proc/stat, a thread that has ended).
  struct Counters {
    std::optional<std::uint64_t> involuntary_switches;  ///< taken off its CPU although it could have gone on
    std::optional<std::uint64_t> minor_faults;          ///< pages mapped at first touch
    std::optional<std::uint64_t> major_faults;          ///< pages read from disk
    std::optional<std::uint64_t> run_delay_ns;          ///< time that it could have run but had no CPU
    std::optional<int> cpu;                             ///< where it ran last
    std::optional<std::uint64_t> cpu_steal_ticks;       ///< of that CPU, taken by the hypervisor; 10 ms each
    std::optional<std::uint64_t> all_steal_ticks;       ///< the same of all CPUs together
  };

  /// @param tid  Linux thread id (gettid) of a thread of this process
  explicit ThreadMonitor(pid_t tid);
  ~ThreadMonitor();
  ThreadMonitor(const ThreadMonitor&) = delete;
  ThreadMonitor& operator=(const ThreadMonitor&) = delete;

  /// Four reads of files that stay open.
  Counters read();

 private:
  // the text of an open file of /proc, empty where it cannot be read
  std::string_view text_of(int file);

  const int status_, stat_, schedstat_, machine_stat_;
  std::vector<char> buffer_;
};

/// The causes of a late tick, in the order in which they are looked for.
enum class LateCause {
  kSteal,       ///< the hypervisor ran somebody else on this CPU
  kPageFault,   ///< the thread touched memory that was not there
  kPreemption,  ///< another thread of this machine took its CPU
  kRunQueue,    ///< it was woken in time and waited for a CPU
  kUnknown,     ///< none of these counted: timer, interrupts, a CPU waking from idle, or no counters
};

/// The likely cause of a tick that came `late_ns` late between two readings. The first that applies:
/// - kSteal: steal grew, of the thread's CPU or, if it moved, of all. It goes first because a stolen CPU also
///   shows as waiting. It is counted in 10 ms, so a shorter theft may show as what follows or as nothing.
/// - kPageFault: a minor or major fault. With locked memory there should be none at all.
/// - kPreemption: an involuntary switch.
/// - kRunQueue: the waiting time grew by at least half of `late_ns`. An undisturbed wake-up adds some tens of
///   nanoseconds too, so readings should lie no more than about a hundred ticks apart.
LateCause late_cause(const ThreadMonitor::Counters& before, const ThreadMonitor::Counters& after,
                     std::int64_t late_ns);

/// "steal", "page fault", "pre-emption", "run queue", "unknown".
std::string name_of(LateCause cause);

}  // namespace palpate
