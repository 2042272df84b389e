#include <dlfcn.h>
#include <errno.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <memory>
#include <string>
#include <thread>

#include "base/test_child.h"
#include "palpate/servo/realtime.h"

/// Granted privileges, and the messages on refusal. Refusals are provoked in child processes that drop their
/// privileges. Limits that even root may not be able to set are simulated by interposed system functions.
/// (realtime_test.cc proves that a tick makes no forbidden call.)

namespace {

// while `on`, system functions return these limits, and memory is only pretended to be locked
struct PretendedSystem {
  bool on = false;
  rlim_t rtprio = 0, memlock_bytes = 0;
  int mlockall_flags = 0;  // flags of the last call; 0 after munlockall
  int mlockall_errno = 0;
} pretended;

// sanitizers make mlockall a no-op, because their shadow memory would not fit
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kRealLocks = false;
#else
constexpr bool kRealLocks = true;
#endif

template <class Function>
Function* real(Function*, const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {
int prlimit(pid_t process, __rlimit_resource resource, const rlimit* requested, rlimit* limit) noexcept {
  if (!pretended.on) return real(&prlimit, "prlimit")(process, resource, requested, limit);
  const rlim_t value = resource == RLIMIT_RTPRIO    ? pretended.rtprio
                       : resource == RLIMIT_MEMLOCK ? pretended.memlock_bytes
                                                    : RLIM_INFINITY;
  *limit = {value, value};
  return 0;
}
int pthread_setschedparam(pthread_t thread, int policy, const sched_param* parameters) noexcept {
  if (pretended.on && static_cast<rlim_t>(parameters->sched_priority) > pretended.rtprio) return EPERM;
  return real(&pthread_setschedparam, "pthread_setschedparam")(thread, policy, parameters);
}
int mlock2(const void* address, size_t size, unsigned flags) noexcept {
  if (!pretended.on) return real(&mlock2, "mlock2")(address, size, flags);
  errno = ENOMEM;
  return size <= pretended.memlock_bytes ? 0 : -1;
}
int mlockall(int flags) noexcept {
  if (!pretended.on) return kRealLocks ? real(&mlockall, "mlockall")(flags) : 0;
  errno = pretended.mlockall_errno;
  if (errno != 0) return -1;
  pretended.mlockall_flags = flags;
  return 0;
}
int munlockall() noexcept {
  if (!pretended.on) return kRealLocks ? real(&munlockall, "munlockall")() : 0;
  pretended.mlockall_flags = 0;
  return 0;
}
}

namespace palpate {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

long locked_KiB() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (word == "VmLck:") {
      long size = 0;
      status >> size;
      return size;
    }
  return -1;
}

// results from a child without privileges
struct Found {
  bool lost_rights = false, fifo = false, memory_locked = false;
  int priority = 0, policy = -1;
  long locked_KiB = -1;
  std::array<char, 200> scheduler{}, memory{};
};

void note(const std::string& text, std::array<char, 200>& to) {
  to[text.copy(to.data(), to.size() - 1)] = 0;
}

TEST(RealtimeThread, RefusalsAreReportedWithoutAnError) {
  testing::Shared<Found> found;
  testing::Child child([&] {
    const rlimit none{0, 0};
    constexpr uid_t kNobody = 65534;
    // capabilities are dropped together with root
    found->lost_rights = ::setrlimit(RLIMIT_RTPRIO, &none) == 0 && ::setrlimit(RLIMIT_MEMLOCK, &none) == 0 &&
                         (::getuid() != 0 || ::setuid(kNobody) == 0);
    const RealtimeGrant grant = make_this_thread_realtime({});
    sched_param parameters{};
    ::pthread_getschedparam(::pthread_self(), &found->policy, &parameters);
    found->fifo = grant.fifo;
    found->priority = grant.priority;
    found->memory_locked = grant.memory_locked;
    found->locked_KiB = locked_KiB();
    note(grant.scheduler, found->scheduler);
    note(grant.memory, found->memory);
  });
  ASSERT_TRUE(child.finished());
  ASSERT_TRUE(found->lost_rights);
  EXPECT_FALSE(found->fifo);
  EXPECT_EQ(found->priority, 0);
  EXPECT_EQ(found->policy, SCHED_OTHER);
  EXPECT_STREQ(found->scheduler.data(),
               "SCHED_OTHER (SCHED_FIFO refused: Operation not permitted; an rtprio limit or CAP_SYS_NICE "
               "allows it)");
  if (!kRealLocks) return;
  EXPECT_FALSE(found->memory_locked);
  EXPECT_EQ(found->locked_KiB, 0);
  EXPECT_STREQ(found->memory.data(),
               "not locked (mlockall refused: Operation not permitted; a memlock limit above 0 KiB or "
               "CAP_IPC_LOCK allows it)");
}

// behaviour on the system that `pretended` simulates
class EmulatedLimits : public ::testing::Test {
 protected:
  EmulatedLimits() { pretended = {.on = true}; }
  ~EmulatedLimits() override { pretended = {}; }
};

TEST_F(EmulatedLimits, PriorityIsLoweredToTheLimit) {
  sched_param lowest{};
  lowest.sched_priority = 1;
  pretended.rtprio = 7;
  std::thread([&] {
    const bool has_fifo = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &lowest) == 0;
    const RealtimeGrant grant = make_this_thread_realtime({.lock_memory = false});
    EXPECT_EQ(grant.fifo, has_fifo);
    EXPECT_EQ(grant.priority, has_fifo ? 7 : 0);
    EXPECT_EQ(grant.scheduler, has_fifo ? "SCHED_FIFO 7 (80 refused; the rtprio limit is 7)"
                                        : "SCHED_OTHER (SCHED_FIFO refused: Operation not permitted; an "
                                          "rtprio limit or CAP_SYS_NICE allows it)");
  }).join();
}

TEST_F(EmulatedLimits, WatchdogStaysAboveTheServoUnderALowLimit) {
  sched_param lowest{};
  lowest.sched_priority = 1;
  pretended.rtprio = 7;
  std::thread([&] {
    if (::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &lowest) != 0) return;
    EXPECT_EQ(make_this_thread_realtime({.lock_memory = false, .priorities_above = 1}).priority, 6);
    EXPECT_EQ(make_this_thread_realtime({.priority = 90, .lock_memory = false}).priority, 7);
  }).join();
}

TEST_F(EmulatedLimits, LimitEqualToTheServoPriorityIsShared) {
  sched_param lowest{};
  lowest.sched_priority = 1;
  pretended.rtprio = 80;
  std::thread([&] {
    if (::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &lowest) != 0) return;
    EXPECT_EQ(make_this_thread_realtime({.lock_memory = false, .priorities_above = 1}).priority, 79);
    EXPECT_EQ(make_this_thread_realtime({.priority = 90, .lock_memory = false}).priority, 80);
  }).join();
  pretended.rtprio = 81;
  std::thread([&] {
    if (::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &lowest) != 0) return;
    EXPECT_EQ(make_this_thread_realtime({.lock_memory = false, .priorities_above = 1}).priority, 80);
  }).join();
}

TEST_F(EmulatedLimits, FiniteMemoryLimitKeepsLaterAllocationsPossible) {
  // with MCL_FUTURE the kernel would refuse every mapping beyond the limit
  pretended.memlock_bytes = 64 << 20;
  {
    const MemoryLock lock;
    EXPECT_TRUE(lock.is_locked());
    EXPECT_EQ(pretended.mlockall_flags, MCL_CURRENT);
    EXPECT_EQ(
        lock.text(),
        "locked (current mappings only; later allocations are not locked: the memlock limit is 64 MiB)");
  }
  pretended.memlock_bytes = RLIM_INFINITY;
  const MemoryLock lock;
  EXPECT_EQ(pretended.mlockall_flags, MCL_CURRENT | MCL_FUTURE);
  EXPECT_EQ(lock.text(), "locked");
}

TEST_F(EmulatedLimits, MemoryStaysLockedUntilTheLastLockEnds) {
  pretended.memlock_bytes = RLIM_INFINITY;
  auto first = std::make_unique<MemoryLock>(), second = std::make_unique<MemoryLock>();
  EXPECT_TRUE(first->is_locked() && second->is_locked());
  first.reset();
  EXPECT_NE(pretended.mlockall_flags, 0);
  first = std::make_unique<MemoryLock>();
  second.reset();
  EXPECT_NE(pretended.mlockall_flags, 0);
  // a refused lock holds nothing and releases nothing
  pretended.mlockall_errno = EAGAIN;
  second = std::make_unique<MemoryLock>();
  EXPECT_FALSE(second->is_locked());
  EXPECT_THAT(second->text(), StartsWith("not locked (mlockall refused: Resource temporarily unavailable"));
  second.reset();
  EXPECT_NE(pretended.mlockall_flags, 0);
  first.reset();
  EXPECT_EQ(pretended.mlockall_flags, 0);
}

TEST(RealtimeThread, GrantsMatchTheSystem) {
  // whether this system grants SCHED_FIFO, queried directly
  bool gives_fifo = false;
  std::thread([&] {
    sched_param parameters{};
    parameters.sched_priority = 42;
    gives_fifo = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters) == 0;
  }).join();

  std::thread([&] {
    const RealtimeGrant grant = make_this_thread_realtime({.priority = 42, .cpu = 0});
    int policy = -1;
    sched_param parameters{};
    ::pthread_getschedparam(::pthread_self(), &policy, &parameters);
    EXPECT_EQ(grant.fifo, policy == SCHED_FIFO);
    EXPECT_EQ(grant.priority, parameters.sched_priority);
    if (gives_fifo) {
      EXPECT_EQ(grant.scheduler, "SCHED_FIFO 42");
    }
    if (kRealLocks) {
      EXPECT_EQ(grant.memory_locked, locked_KiB() > 0) << grant.memory;
    }
    EXPECT_EQ(grant.memory_locked, grant.memory.starts_with("locked"));
    if (grant.cpu == 0) {
      EXPECT_EQ(::sched_getcpu(), 0);
    }

    std::array<char, 16> name{};
    ::pthread_getname_np(::pthread_self(), name.data(), name.size());
    EXPECT_STREQ(name.data(), "palpate-servo");
  }).join();
  if (kRealLocks) {
    EXPECT_EQ(locked_KiB(), 0) << "unlocked when the thread ended";
  }
}

TEST(RealtimeThread, UnrequestedPropertiesAreUnchanged) {
  std::thread([] {
    const RealtimeGrant grant = make_this_thread_realtime({.fifo = false, .lock_memory = false});
    EXPECT_FALSE(grant.fifo);
    EXPECT_EQ(grant.priority, 0);
    EXPECT_EQ(grant.cpu, -1);
    EXPECT_FALSE(grant.memory_locked);
    EXPECT_EQ(grant.scheduler, "SCHED_OTHER (SCHED_FIFO not requested)");
    EXPECT_EQ(grant.memory, "not locked (not requested)");
    // steps that need no privilege are still performed
    EXPECT_EQ(::prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0), 1);
    if (kRealLocks) {
      EXPECT_EQ(locked_KiB(), 0);
    }
  }).join();
}

TEST(RealtimeThread, MissingCpuIsReported) {
  std::thread([] {
    for (const int cpu : {CPU_SETSIZE - 1, CPU_SETSIZE, 1 << 30}) {
      const RealtimeGrant grant =
          make_this_thread_realtime({.fifo = false, .lock_memory = false, .cpu = cpu});
      EXPECT_EQ(grant.cpu, -1);
      EXPECT_THAT(grant.scheduler,
                  HasSubstr("not bound to CPU " + std::to_string(cpu) + ": Invalid argument"));
    }
  }).join();
}

// --- stack ---

long faults_of_this_thread() {
  rusage usage{};
  ::getrusage(RUSAGE_THREAD, &usage);
  return usage.ru_minflt;
}

[[gnu::noinline]] void use_stack() {
  volatile char room[400 << 10];
  for (std::size_t i = 0; i < sizeof(room); i += 1024) room[i] = 1;
}

// page faults of a thread that uses 400 KiB of a stack of this size
long faults_of_using_the_stack(std::size_t stack_bytes, bool prepare, bool use) {
  struct Job {
    bool prepare, use;
    long faults = -1;
  } job{prepare, use};
  void* stack = ::mmap(nullptr, stack_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ::madvise(stack, stack_bytes, MADV_NOHUGEPAGE);
  pthread_attr_t attributes;
  ::pthread_attr_init(&attributes);
  ::pthread_attr_setstack(&attributes, stack, stack_bytes);
  pthread_t thread{};
  const auto run = [](void* argument) -> void* {
    Job& task = *static_cast<Job*>(argument);
    if (task.prepare) make_this_thread_realtime({.fifo = false, .lock_memory = false});
    const long before = faults_of_this_thread();
    if (task.use) use_stack();
    task.faults = faults_of_this_thread() - before;
    return nullptr;
  };
  EXPECT_EQ(::pthread_create(&thread, &attributes, run, &job), 0);
  ::pthread_join(thread, nullptr);
  ::pthread_attr_destroy(&attributes);
  ::munmap(stack, stack_bytes);
  return job.faults;
}

// with preparation; minimum of several tries, because the kernel may move a page, which also faults
long fewest_faults(std::size_t stack_bytes, bool use) {
  long fewest = faults_of_using_the_stack(stack_bytes, true, use);
  for (int n = 0; n < 4 && fewest > 0; ++n)
    fewest = std::min(fewest, faults_of_using_the_stack(stack_bytes, true, use));
  return fewest;
}

TEST(RealtimeThread, StackPagesAreResidentBeforeUse) {
  EXPECT_GE(faults_of_using_the_stack(2 << 20, false, true), 90) << "without it every page is a fault";
  // a sanitizer's own memory may cause a few
  EXPECT_LE(fewest_faults(2 << 20, true), kRealLocks ? 0 : 30);
}

#if !defined(__SANITIZE_THREAD__)  // its runtime uses more than this of every stack
TEST(RealtimeThread, ShortStackIsNotOverrun) {
  // below the 512 KiB that are touched on larger stacks
  EXPECT_EQ(fewest_faults(256 << 10, false), 0);
}
#endif

}  // namespace
}  // namespace palpate
