#include "servo/watchdog.h"

#include <chrono>
#include <future>

#include "palpate/base/clock.h"
#include "palpate/servo/realtime.h"

namespace palpate {
namespace {

constexpr auto kWatch = std::chrono::milliseconds(1);
// above the servo's priority, so that a tick that never ends cannot block the watchdog
constexpr int kPriority = 90;
// number of ticks after a halt before the devices resume
constexpr std::uint64_t kTicksToTrust = 5;

}  // namespace

std::string Watchdog::begin(bool realtime, int servo_cpu) {
  std::promise<std::string> scheduler;
  auto started = scheduler.get_future();
  thread_ = std::thread([this, realtime, servo_cpu, &scheduler] {
    exclude_cpu(servo_cpu);
    // if the priority is refused, the watchdog runs with ordinary scheduling
    scheduler.set_value(make_this_thread_realtime({.fifo = realtime,
                                                   .priority = kPriority,
                                                   .lock_memory = false,
                                                   .cpu = -1,
                                                   .priorities_above = 0,
                                                   .name = "palpate-guard"})
                            .scheduler);
    guard();
  });
  return started.get();
}

void Watchdog::end() {
  end_.store(true);
  if (thread_.joinable()) thread_.join();
  // a supervisor's halt is ended by the next loop
  if (halted_.exchange(false))
    driver_.resume(heartbeat_ != nullptr ? heartbeat_->newest_ended_halt.load() : 0);
}

void Watchdog::guard() {
  while (!end_.load(std::memory_order_relaxed)) {
    std::this_thread::sleep_for(kWatch);
    check(monotonic_ns());
  }
}

void Watchdog::check(std::int64_t now_ns) {
  const std::int64_t beat_ns = beat_ns_.load(std::memory_order_acquire);
  const std::uint64_t beats = beats_.load(std::memory_order_relaxed);
  const bool stalled = !standing_down_.load() && beat_ns != kResting && now_ns - beat_ns > kStall_ns;
  // read before the devices resume, so that a later halt is not ended with this one
  const std::uint64_t halts = heartbeat_ != nullptr ? heartbeat_->newest_halt.load() : 0;
  const bool halted_outside = heartbeat_ != nullptr && halts != heartbeat_->newest_ended_halt.load();
  if (heartbeat_ != nullptr) heartbeat_->checked_ns.store(now_ns);
  if (!halted_ && (stalled || halted_outside)) {
    halted_.store(true, std::memory_order_release);
    driver_.halt();
    stalls_.fetch_add(1);
    beats_when_halted_ = beats;
  } else if (halted_ && !stalled && beats >= beats_when_halted_ + kTicksToTrust) {
    driver_.resume(halts);
    if (heartbeat_ != nullptr) heartbeat_->newest_ended_halt.store(halts);
    halted_.store(false, std::memory_order_release);
  }
}

}  // namespace palpate
