#include "palpate/servo/realtime.h"

#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>

namespace palpate {
namespace {

constexpr std::size_t kStack_bytes = 512 << 10;
// not touched, at the low end of the stack: the guard page, and frames of functions called from here
constexpr std::size_t kStackMargin_bytes = 32 << 10;

std::size_t page_bytes() {
  return static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

// --- memory ---

std::mutex memory_mutex;
int memory_locks = 0;

rlim_t memlock_limit() {
  rlimit limit{};
  return ::prlimit(0, RLIMIT_MEMLOCK, nullptr, &limit) == 0 ? limit.rlim_cur : 0;
}

std::string size_text(rlim_t bytes) {
  constexpr rlim_t kMiB = 1 << 20;
  return bytes >= kMiB ? std::to_string(bytes / kMiB) + " MiB" : std::to_string(bytes / 1024) + " KiB";
}

// Whether more memory can be locked than the limit states. Tested by locking, because a capability that is
// reported may have no effect, as inside a user namespace.
bool limit_does_not_apply(rlim_t limit) {
  if (limit == RLIM_INFINITY) return true;
  const std::size_t size = limit + page_bytes();
  void* room = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (room == MAP_FAILED) return false;
  const bool locked = ::mlock2(room, size, MLOCK_ONFAULT) == 0;
  ::munmap(room, size);
  return locked;
}

// --- scheduling ---

int rtprio_limit() {
  rlimit limit{};
  return ::prlimit(0, RLIMIT_RTPRIO, nullptr, &limit) == 0
             ? static_cast<int>(std::min<rlim_t>(limit.rlim_cur, 99))
             : 0;
}

// Priority granted, 0 if none; then errno holds the reason.
int enter_fifo(int priority, int priorities_above) {
  const auto set = [](int value) {
    sched_param parameters{};
    parameters.sched_priority = value;
    errno = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters);
    return errno == 0;
  };
  // the priority above is tried first: the limit may allow the requested one and nothing higher
  if (set(priority + priorities_above) && (priorities_above == 0 || set(priority))) return priority;

  // a lower priority still precedes every ordinary thread
  const int refusal = errno;
  const int limit = refusal == EPERM ? rtprio_limit() : 0;
  if (limit > 0 && limit < priority + std::max(1, priorities_above)) {
    const int lower = std::max(1, limit - priorities_above);
    if (set(lower)) return lower;
  }
  errno = refusal;
  return 0;
}

std::string policy_name(int policy) {
  switch (policy) {
    case SCHED_OTHER:
      return "SCHED_OTHER";
    case SCHED_FIFO:
      return "SCHED_FIFO";
    case SCHED_RR:
      return "SCHED_RR";
    case SCHED_BATCH:
      return "SCHED_BATCH";
    case SCHED_IDLE:
      return "SCHED_IDLE";
    default:
      return "policy " + std::to_string(policy);
  }
}

void grant_scheduler(const RealtimeRequest& request, RealtimeGrant& grant) {
  std::string remark;
  if (!request.fifo) {
    remark = " (SCHED_FIFO not requested)";
  } else if (const int granted_priority = enter_fifo(request.priority, request.priorities_above);
             granted_priority == 0) {
    const int why = errno;
    remark = std::string(" (SCHED_FIFO refused: ") + ::strerror(why) +
             (why == EPERM ? "; an rtprio limit or CAP_SYS_NICE allows it)" : ")");
  } else if (granted_priority < request.priority) {
    remark = " (" + std::to_string(request.priority) + " refused; the rtprio limit is " +
             std::to_string(rtprio_limit()) + (request.priorities_above > 0 ? ", the watchdog's)" : ")");
  }

  // the actual policy, which may differ from the request
  int policy = SCHED_OTHER;
  sched_param parameters{};
  ::pthread_getschedparam(::pthread_self(), &policy, &parameters);
  grant.fifo = policy == SCHED_FIFO;
  grant.priority = parameters.sched_priority;
  grant.scheduler = scheduler_of_thread(0) + remark;
}

void grant_cpu(int cpu, RealtimeGrant& grant) {
  if (cpu < 0) return;
  cpu_set_t set;
  CPU_ZERO(&set);
  if (cpu < CPU_SETSIZE) CPU_SET(static_cast<unsigned>(cpu), &set);
  if (::sched_setaffinity(0, sizeof(set), &set) == 0)
    grant.cpu = cpu;
  else
    grant.scheduler += ", not bound to CPU " + std::to_string(cpu) + ": " + ::strerror(errno);
}

// --- stack ---

// Unused size of this thread's stack below the caller's frame, less a safety margin; 0: unknown.
std::size_t remaining_stack_bytes() {
  pthread_attr_t attributes;
  if (::pthread_getattr_np(::pthread_self(), &attributes) != 0) return 0;
  void* lowest = nullptr;
  std::size_t size = 0;
  const bool known = ::pthread_attr_getstack(&attributes, &lowest, &size) == 0;
  ::pthread_attr_destroy(&attributes);
  if (!known) return 0;
  const std::size_t left =
      reinterpret_cast<std::uintptr_t>(__builtin_frame_address(0)) - reinterpret_cast<std::uintptr_t>(lowest);
  return left > kStackMargin_bytes ? left - kStackMargin_bytes : 0;
}

// allocates a stack frame and touches its pages, which stay mapped after it returns
[[gnu::noinline]] void touch_stack(std::size_t size) {
  volatile char* stack = static_cast<volatile char*>(__builtin_alloca(size));
  // towards lower addresses, as a stack grows
  for (std::size_t i = size; i > 0; i -= std::min(i, page_bytes())) stack[i - 1] = 0;
}

}  // namespace

MemoryLock::MemoryLock() {
  const std::lock_guard guard(memory_mutex);
  const rlim_t limit = memlock_limit();
  const bool later_too = limit_does_not_apply(limit);
  is_locked_ = ::mlockall(later_too ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) == 0;
  if (is_locked_) {
    ++memory_locks;
    text_ = "locked";
    if (!later_too)
      text_ += " (current mappings only; later allocations are not locked: the memlock limit is " +
               size_text(limit) + ")";
  } else {
    text_ = std::string("not locked (mlockall refused: ") + ::strerror(errno) + "; a memlock limit above " +
            size_text(limit) + " or CAP_IPC_LOCK allows it)";
  }
}

MemoryLock::~MemoryLock() {
  if (!is_locked_) return;
  const std::lock_guard guard(memory_mutex);
  if (--memory_locks == 0) ::munlockall();
}

void exclude_cpu(int cpu) {
  CpuExclusion().exclude(cpu);
}

CpuExclusion::CpuExclusion() {
  if (::sched_getaffinity(0, sizeof(all_), &all_) != 0) CPU_ZERO(&all_);
}

void CpuExclusion::exclude(int cpu) {
  if (cpu == cpu_ || cpu >= CPU_SETSIZE) return;
  cpu_ = cpu;
  cpu_set_t set = all_;
  if (cpu >= 0) CPU_CLR(static_cast<unsigned>(cpu), &set);
  if (CPU_COUNT(&set) == 0) set = all_;
  if (CPU_COUNT(&set) > 0) ::sched_setaffinity(0, sizeof(set), &set);
}

std::string scheduler_of_thread(pid_t tid) {
  const int policy = ::sched_getscheduler(tid);
  sched_param parameters{};
  if (policy < 0 || ::sched_getparam(tid, &parameters) != 0) return "";
  std::string text = policy_name(policy & ~SCHED_RESET_ON_FORK);
  if (parameters.sched_priority > 0) text += " " + std::to_string(parameters.sched_priority);
  return text;
}

RealtimeGrant make_this_thread_realtime(const RealtimeRequest& request) {
  RealtimeGrant grant;
  // before SCHED_FIFO, which needs no timer slack and under which newer kernels refuse to set it
  ::prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
  ::pthread_setname_np(::pthread_self(), request.name);
  sigset_t all;
  ::sigfillset(&all);
  ::pthread_sigmask(SIG_BLOCK, &all, nullptr);

  thread_local std::optional<MemoryLock> lock;
  if (!request.lock_memory)
    lock.reset();
  else if (!lock || !lock->is_locked())
    lock.emplace();
  grant.memory_locked = lock && lock->is_locked();
  grant.memory = lock ? lock->text() : "not locked (not requested)";

  touch_stack(std::min(kStack_bytes, remaining_stack_bytes()));

  // last, so that none of this runs with real-time priority
  grant_scheduler(request, grant);
  grant_cpu(request.cpu, grant);
  return grant;
}

}  // namespace palpate
