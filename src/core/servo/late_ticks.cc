#include "servo/late_ticks.h"

#include <unistd.h>

#include <chrono>
#include <optional>

#include "palpate/servo/realtime.h"
#include "servo/thread_monitor.h"

namespace palpate {
namespace {

constexpr auto kPollInterval = std::chrono::milliseconds(10);

}  // namespace

void LateTicks::begin(int servo_cpu) {
  thread_ = std::thread([this, servo_cpu] {
    exclude_cpu(servo_cpu);
    find_causes();
  });
}

void LateTicks::end() {
  end_.store(true);
  if (thread_.joinable()) thread_.join();
}

// thread_local instead of comparing thread addresses: a new thread may reuse the address of one that has
// ended
void LateTicks::tick_here() noexcept {
  thread_local const pid_t tid = ::gettid();
  tid_.store(tid, std::memory_order_relaxed);
}

void LateTicks::add(std::int64_t late_ns, std::uint64_t ticks) noexcept {
  // the reading thread only resets the maximum, so that losing one of two concurrent updates is harmless
  if (late_ns > worst_ns_.load(std::memory_order_relaxed))
    worst_ns_.store(late_ns, std::memory_order_relaxed);
  late_.store(late_.load(std::memory_order_relaxed) + ticks, std::memory_order_release);
}

void LateTicks::find_causes() {
  pid_t watched = 0;
  std::optional<ThreadMonitor> monitor;
  ThreadMonitor::Counters before;
  std::uint64_t count = 0;
  while (true) {
    const bool last = end_.load();
    const std::uint64_t late = late_.load(std::memory_order_acquire);
    const std::int64_t worst_ns = worst_ns_.exchange(0, std::memory_order_relaxed);
    // counters of two threads have no meaningful difference: ticks that were late during a change stay
    // kUnknown
    if (const pid_t ticking = tid_.load(std::memory_order_relaxed); ticking != watched) {
      watched = ticking;
      monitor.emplace(watched);
      before = {};
    }
    ThreadMonitor::Counters after = monitor ? monitor->read() : ThreadMonitor::Counters();
    if (late > count) {
      const LateCause cause = late_cause(before, after, worst_ns);
      by_cause_[static_cast<std::size_t>(cause)].fetch_add(late - count);
      count = late;
    }
    before = std::move(after);
    if (last) return;
    std::this_thread::sleep_for(kPollInterval);
  }
}

std::string LateTicks::scheduler() const {
  const pid_t ticking = tid_.load(std::memory_order_relaxed);
  return ticking == 0 ? "" : scheduler_of_thread(ticking);
}

LateCounts LateTicks::counts() const {
  const auto of = [&](LateCause cause) { return by_cause_[static_cast<std::size_t>(cause)].load(); };
  return {of(LateCause::kSteal), of(LateCause::kPageFault), of(LateCause::kPreemption),
          of(LateCause::kRunQueue), of(LateCause::kUnknown)};
}

}  // namespace palpate
