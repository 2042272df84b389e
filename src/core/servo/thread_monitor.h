#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Cause of a late tick, observed from outside: another thread reads the kernel's counters of the servo
/// thread, so that the servo makes no system call for it.
namespace palpate {

class ThreadMonitor {
 public:
  /// The kernel's counters of a thread since it started. Empty where the kernel does not provide one (no
  /// schedstat, a container that hides /proc/stat, a thread that has ended).
  struct Counters {
    std::optional<std::uint64_t> involuntary_switches;  ///< Times it was descheduled while runnable
    std::optional<std::uint64_t> minor_faults;          ///< Pages mapped on first access
    std::optional<std::uint64_t> major_faults;          ///< Pages read from disk
    std::optional<std::uint64_t> run_delay_ns;          ///< Time it was runnable without a CPU
    std::optional<int> cpu;                             ///< CPU it ran on last
    /// Time of that CPU taken by the hypervisor; in units of 10 ms
    std::optional<std::uint64_t> cpu_steal_ticks;
    std::optional<std::uint64_t> all_steal_ticks;  ///< The same for all CPUs together
  };

  /// @param tid  Linux thread id (gettid) of a thread of this process
  explicit ThreadMonitor(pid_t tid);
  ~ThreadMonitor();
  ThreadMonitor(const ThreadMonitor&) = delete;
  ThreadMonitor& operator=(const ThreadMonitor&) = delete;

  /// Reads all counters: four reads of files that stay open.
  Counters read();

 private:
  // content of an open /proc file; empty if it cannot be read
  std::string_view text_of(int file);

  const int status_, stat_, schedstat_, machine_stat_;
  std::vector<char> buffer_;
};

/// Causes of a late tick, in the order in which they are tested.
enum class LateCause {
  kSteal,       ///< The hypervisor ran another guest on this CPU
  kPageFault,   ///< The thread accessed memory that was not resident
  kPreemption,  ///< Another thread of this machine took its CPU
  kRunQueue,    ///< The thread was woken in time and waited for a CPU
  kUnknown,     ///< None of these: timer, interrupts, a CPU waking from idle, or no counters
};

/// Likely cause of a tick that was `late_ns` late between two readings. The first condition that applies:
/// - kSteal: the steal time of the thread's CPU grew or, if the thread moved, that of all CPUs. Tested first,
/// because steal time also appears as run delay. It is counted in units of 10 ms, so a shorter steal may be
/// attributed to a later cause or to none.
/// - kPageFault: a minor or major fault. With locked memory there should be none.
/// - kPreemption: an involuntary switch.
/// - kRunQueue: the waiting time grew by at least half of `late_ns`. An undisturbed wake-up adds some tens of
/// nanoseconds too, so readings should be no more than about a hundred ticks apart.
LateCause late_cause(const ThreadMonitor::Counters& before, const ThreadMonitor::Counters& after,
                     std::int64_t late_ns);

/// "steal", "page fault", "pre-emption", "run queue", "unknown".
std::string name_of(LateCause cause);

}  // namespace palpate
