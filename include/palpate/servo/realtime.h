#pragma once

#include <sched.h>
#include <sys/types.h>

#include <string>

/// Real-time privileges of a thread: scheduling class, locked memory, and pages that are resident before they
/// are needed. The system may refuse any of them; a refusal is reported and is not an error.
namespace palpate {

/// Privileges to request from the system.
struct RealtimeRequest {
  bool fifo = true;         ///< Request SCHED_FIFO, which precedes every ordinary thread
  int priority = 80;        ///< SCHED_FIFO priority, 1 ... 99; higher runs first
  bool lock_memory = true;  ///< Lock the process's pages in memory
  int cpu = -1;             ///< CPU to bind the thread to; -1: any
  /// Number of priorities to leave free above this one where the rtprio limit is lower than requested
  int priorities_above = 0;
  const char* name = "palpate-servo";  ///< Thread name, up to 15 characters
};

/// Privileges that the system granted.
struct RealtimeGrant {
  bool fifo = false;
  /// SCHED_FIFO priority, 0 without it; below the requested one where the rtprio limit is lower
  int priority = 0;
  bool memory_locked = false;
  int cpu = -1;                ///< CPU that the thread is bound to; -1: none
  std::string scheduler = {};  ///< "SCHED_FIFO 80", or the actual scheduler and the reason
  std::string memory = {};     ///< "locked", or the actual state and the reason
};

/// Requests real-time privileges for the calling thread, and returns those granted. It also touches 512 KiB
/// of the thread's stack (or all of it, if that is less), sets the timer slack to 1 ns, names the thread and
/// blocks every signal on it. Memory stays locked until the thread ends or calls this without lock_memory.
/// Allocates, so it must not be called from within the loop.
RealtimeGrant make_this_thread_realtime(const RealtimeRequest& request);

/// Scheduling policy and priority of a thread: "SCHED_FIFO 80", "SCHED_OTHER". Empty if there is no such
/// thread.
/// @param tid  Linux thread id (gettid); 0: the calling thread
std::string scheduler_of_thread(pid_t tid);

/// Removes `cpu` from the affinity mask of the calling thread, so that the servo has it to itself. No effect
/// if `cpu` is negative or the only CPU in the mask.
void exclude_cpu(int cpu);

/// Keeps the constructing thread off another thread's CPU, which may change over time.
class CpuExclusion {
 public:
  CpuExclusion();
  /// Sets the affinity mask to all CPUs of the mask at construction except `cpu`; to all of them if `cpu` is
  /// negative or the only one. Makes a system call only if `cpu` differs from the last call.
  void exclude(int cpu);

 private:
  cpu_set_t all_;
  int cpu_ = -1;
};

/// Keeps the memory of the whole process locked (mlockall) while at least one instance exists, in any thread.
/// Later mappings are locked too, unless a finite memlock limit applies: it would make a later allocation
/// fail, so only current mappings are locked then.
class MemoryLock {
 public:
  MemoryLock();
  ~MemoryLock();
  MemoryLock(const MemoryLock&) = delete;
  MemoryLock& operator=(const MemoryLock&) = delete;

  bool is_locked() const { return is_locked_; }
  /// "locked", or the actual state and the reason.
  const std::string& text() const { return text_; }

 private:
  bool is_locked_ = false;
  std::string text_;
};

}  // namespace palpate
