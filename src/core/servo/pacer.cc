#include "servo/pacer.h"

#include <errno.h>
#include <time.h>

#include <algorithm>
#include <cmath>

#include "palpate/base/check.h"
#include "palpate/base/clock.h"

namespace palpate {
namespace {

constexpr double kNs_per_s = 1e9;
constexpr double kMaxSpin_periods = 0.8;

// spin-wait hint to the core: saves power and yields to the other hyper-thread
inline void relax() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

double period_of(double rate_hz) {
  PALPATE_CHECK(std::isfinite(rate_hz) && rate_hz > 0);
  return kNs_per_s / rate_hz;
}

std::int64_t spin_within(double spin_s, double period_ns) {
  PALPATE_CHECK(spin_s >= 0);
  return std::llround(std::min(spin_s * kNs_per_s, kMaxSpin_periods * period_ns));
}

}  // namespace

Pacer::Pacer(double rate_hz, double spin_s, const std::atomic<bool>& stop)
    : period_ns_(period_of(rate_hz)), spin_ns_(spin_within(spin_s, period_ns_)), stop_(stop) {}

bool Pacer::wait() noexcept {
  if (stopped()) return false;
  const std::int64_t now_ns = monotonic_ns();
  if (!started_) {
    started_ = true;
    start_ns_ = now_ns;
  }

  // the next grid point, or the first one in the future
  ++point_;
  if (grid_ns(point_) <= now_ns) {
    const std::int64_t missed = point_;
    point_ = static_cast<std::int64_t>(static_cast<double>(now_ns - start_ns_) / period_ns_);
    while (grid_ns(point_) <= now_ns) ++point_;
    skipped_ += static_cast<std::uint64_t>(point_ - missed);
  }
  scheduled_ns_ = grid_ns(point_);

  if (scheduled_ns_ - spin_ns_ > now_ns) sleep_until(scheduled_ns_ - spin_ns_);
  while (monotonic_ns() < scheduled_ns_ && !stopped()) relax();
  return !stopped();
}

std::int64_t Pacer::period_ns() const {
  return std::llround(period_ns_);
}

std::int64_t Pacer::grid_ns(std::int64_t point) const {
  return start_ns_ + std::llround(static_cast<double>(point) * period_ns_);
}

void Pacer::sleep_until(std::int64_t time_ns) const noexcept {
  constexpr std::int64_t kNs = 1'000'000'000;
  const timespec time{time_ns / kNs, static_cast<long>(time_ns % kNs)};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr) == EINTR && !stopped()) {
  }
}

}  // namespace palpate
