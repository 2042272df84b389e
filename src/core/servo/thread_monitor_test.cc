#include "servo/thread_monitor.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "base/test_wait.h"
#include "palpate/base/clock.h"

namespace palpate {
namespace {

// a thread that performs one of its tasks on request, and otherwise does nothing that the kernel counts
class Watched {
 public:
  explicit Watched(std::function<void()> task) : thread_([this, work = std::move(task)] { run(work); }) {
    while (tid_ == 0) std::this_thread::yield();
  }
  ~Watched() {
    ended_ = true;
    thread_.join();
  }
  pid_t tid() const { return tid_; }
  void work() {
    const int before = done_;
    ++requested_;
    while (done_ == before) std::this_thread::yield();
  }

 private:
  void run(const std::function<void()>& task) {
    tid_ = ::gettid();
    while (!ended_) {
      if (requested_ > done_) {
        task();
        ++done_;
      }
      std::this_thread::yield();
    }
  }
  std::atomic<pid_t> tid_ = 0;
  std::atomic<int> requested_ = 0, done_ = 0;
  std::atomic<bool> ended_ = false;
  std::thread thread_;
};

std::uint64_t gained(const std::optional<std::uint64_t>& before, const std::optional<std::uint64_t>& after) {
  return before && after ? *after - *before : 0;
}

// steal time of a shared machine could hide the cause that a test provokes
ThreadMonitor::Counters without_steal(ThreadMonitor::Counters counters) {
  counters.cpu_steal_ticks.reset();
  counters.all_steal_ticks.reset();
  return counters;
}

TEST(ThreadMonitor, CountsPageFaultsOfTheWatchedThread) {
  constexpr std::size_t kPages = 200;
  const std::size_t size = kPages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  Watched watched([&] {
    void* room = ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    ::madvise(room, size, MADV_NOHUGEPAGE);
    for (std::size_t i = 0; i < size; i += size / kPages) static_cast<volatile char*>(room)[i] = 1;
    ::munmap(room, size);
  });
  ThreadMonitor monitor(watched.tid());
  watched.work();
  const auto before = monitor.read();
  const auto idle = monitor.read();
  watched.work();
  const auto after = monitor.read();
  ASSERT_TRUE(before.minor_faults && before.major_faults && before.cpu && before.involuntary_switches);
  EXPECT_LT(gained(before.minor_faults, idle.minor_faults), 10u) << "nothing touched";
  EXPECT_GE(gained(idle.minor_faults, after.minor_faults), kPages);
  // a sanitizer faults on some of its own pages for each
  EXPECT_LT(gained(idle.minor_faults, after.minor_faults), 10 * kPages);
  EXPECT_EQ(late_cause(without_steal(idle), without_steal(after), 100'000), LateCause::kPageFault);
}

TEST(ThreadMonitor, DetectsPreemptionByAnotherThread) {
  cpu_set_t all, one;
  CPU_ZERO(&all);
  ASSERT_EQ(::sched_getaffinity(0, sizeof(all), &all), 0);
  unsigned cpu = 0;
  while (!CPU_ISSET(cpu, &all)) ++cpu;
  CPU_ZERO(&one);
  CPU_SET(cpu, &one);

  std::atomic<bool> pinned = true, stop = false;
  std::atomic<pid_t> tid = 0;
  const auto compete = [&](bool watched) {
    if (::sched_setaffinity(0, sizeof(one), &one) != 0) pinned = false;
    if (watched) tid = ::gettid();
    while (!stop) {
    }
  };
  std::thread watched(compete, true), other(compete, false);
  while (tid == 0) std::this_thread::yield();

  ThreadMonitor monitor(tid);
  const auto before = monitor.read();
  auto after = before;
  for (const std::int64_t end_ns = monotonic_ns() + 60'000'000'000;
       pinned && gained(before.involuntary_switches, after.involuntary_switches) < 3 &&
       monotonic_ns() < end_ns;) {
    ::usleep(1000);
    after = monitor.read();
  }
  stop = true;
  watched.join();
  other.join();
  if (!pinned) GTEST_SKIP() << "this system does not let a thread be bound to a CPU";
  EXPECT_EQ(after.cpu, static_cast<int>(cpu));
  EXPECT_GE(gained(before.involuntary_switches, after.involuntary_switches), 3u);
  // two threads on one CPU: one waited while the other ran
  if (before.run_delay_ns) {
    EXPECT_GT(gained(before.run_delay_ns, after.run_delay_ns), 100'000u);
  }
  // a fault would take precedence; an empty loop should have none, but the kernel may move its pages
  after.minor_faults = before.minor_faults;
  EXPECT_EQ(late_cause(without_steal(before), without_steal(after), 100'000), LateCause::kPreemption);
}

TEST(ThreadMonitor, MissingThreadIsUnknownWithoutAnError) {
  auto watched = std::make_unique<Watched>([] {});
  ThreadMonitor ended(watched->tid()), never(1 << 30);
  EXPECT_TRUE(ended.read().minor_faults);
  const std::string listed = "/proc/self/task/" + std::to_string(watched->tid());
  watched.reset();
  // a joined thread may remain listed for a moment
  EXPECT_TRUE(testing::soon([&] { return !std::filesystem::exists(listed); }));
  for (ThreadMonitor* monitor : {&ended, &never}) {
    const auto counters = monitor->read();
    EXPECT_FALSE(counters.involuntary_switches || counters.minor_faults || counters.major_faults ||
                 counters.run_delay_ns || counters.cpu || counters.cpu_steal_ticks);
    EXPECT_EQ(late_cause(without_steal(counters), without_steal(monitor->read()), 1000), LateCause::kUnknown);
  }
}

TEST(LateCause, IsTheFirstApplicableCause) {
  ThreadMonitor::Counters before;
  before.involuntary_switches = before.minor_faults = before.major_faults = before.run_delay_ns = 10;
  before.cpu_steal_ticks = before.all_steal_ticks = 10;
  before.cpu = 1;
  auto after = before;
  EXPECT_EQ(late_cause(before, after, 1000), LateCause::kUnknown);

  // from the weakest cause to the strongest: each takes precedence over those before it
  after.run_delay_ns = 10 + 499;
  EXPECT_EQ(late_cause(before, after, 1000), LateCause::kUnknown) << "too short to explain it";
  after.run_delay_ns = 10 + 500;
  EXPECT_EQ(late_cause(before, after, 1000), LateCause::kRunQueue);
  after.involuntary_switches = 11;
  EXPECT_EQ(late_cause(before, after, 1000), LateCause::kPreemption);
  after.major_faults = 11;
  EXPECT_EQ(late_cause(before, after, 1000), LateCause::kPageFault);
  after.all_steal_ticks = 11;
  EXPECT_EQ(late_cause(before, after, 1000), LateCause::kPageFault) << "from another CPU than the thread's";
  after.cpu = 2;
  EXPECT_EQ(late_cause(before, after, 1000), LateCause::kSteal) << "it moved: from any CPU";
  after.cpu = 1;
  after.cpu_steal_ticks = 11;
  EXPECT_EQ(late_cause(before, after, 1000), LateCause::kSteal);

  // missing counters are no cause
  EXPECT_EQ(late_cause({}, after, 1000), LateCause::kUnknown);
  EXPECT_EQ(late_cause(before, {}, 1000), LateCause::kUnknown);
}

TEST(LateCause, HasAName) {
  EXPECT_EQ(name_of(LateCause::kSteal), "steal");
  EXPECT_EQ(name_of(LateCause::kPageFault), "page fault");
  EXPECT_EQ(name_of(LateCause::kPreemption), "pre-emption");
  EXPECT_EQ(name_of(LateCause::kRunQueue), "run queue");
  EXPECT_EQ(name_of(LateCause::kUnknown), "unknown");
}

}  // namespace
}  // namespace palpate
