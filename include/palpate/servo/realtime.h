#pragma once

#include <sched.h>
#include <sys/types.h>

#include <string>

/// What makes a thread of ours real-time: its scheduling class, memory that is never paged, pages that are
/// there before they are needed. All of it may be refused by the system, which is no error: it is said.
namespace palpate {

/// What to ask the system for.
struct RealtimeRequest {
  bool fifo = true;         ///< SCHED_FIFO: before every ordinary thread
  int priority = 80;        ///< 1 ... 99, of SCHED_FIFO; higher goes first
  bool lock_memory = true;  ///< no page of the process is written out or dropped
  int cpu = -1;             ///< the only CPU to run on; -1: any
  int leave_above = 0;  ///< where the rtprio limit is lower: so many priorities stay free for others of ours
  const char* name = "palpate-servo";  ///< of the thread, up to 15 characters
};

/// What the system gave.
struct RealtimeGrant {
  bool fifo = false;
  int priority = 0;  ///< of SCHED_FIFO, 0 without it; less than asked for where the rtprio limit is lower
  bool memory_locked = false;
  int cpu = -1;                ///< the CPU that the thread is bound to, -1: none
  std::string scheduler = {};  ///< "SCHED_FIFO 80", or what it is instead and why
  std::string memory = {};     ///< "locked", or what it is instead and why
};

/// Makes the calling thread real-time as far as the system allows, and says how far that is. Besides what is
/// asked for it touches 512 KiB of the thread's stack (or what there is of it), sets the timer slack to 1 ns
/// names the thread and blocks every signal on it. Memory stays locked until the thread ends, or asks without
/// lock_memory. Allocates, so not from within the loop.
RealtimeGrant make_this_thread_realtime(const RealtimeRequest& request);

/// What a thread has: "SCHED_FIFO 80", "SCHED_OTHER". Empty: there is no such thread.
/// @param tid  Linux thread id (gettid); 0: the calling thread
std::string scheduler_of_thread(pid_t tid);

/// Binds the calling thread to the CPUs that it may run on but `cpu`, which then is the servo's alone;
/// nothing where `cpu` is negative or the only one.
void keep_off_cpu(int cpu);

/// Keeps the thread that makes it off the CPU of another thread, which may change.
class OtherCpus {
 public:
  OtherCpus();
  /// From now on all that the thread could run on when this was made, but `cpu`; all of them where that is
  /// negative or the only one. A system call where it is another one than the last time.
  void than(int cpu);

 private:
  cpu_set_t all_;
  int cpu_ = -1;
};

/// Keeps the memory of the whole process locked (mlockall) while at least one of these lives, in whatever
/// threads. What is mapped later is locked too, unless a finite memlock limit applies: there it would turn a
/// later allocation into a failure, and only what is mapped now is locked.
class MemoryLock {
 public:
  MemoryLock();
  ~MemoryLock();
  MemoryLock(const MemoryLock&) = delete;
  MemoryLock& operator=(const MemoryLock&) = delete;

  bool held() const { return held_; }
  /// "locked", or what it is instead and why.
  const std::string& text() const { return text_; }

 private:
  bool held_ = false;
  std::string text_;
};

}  // namespace palpate
