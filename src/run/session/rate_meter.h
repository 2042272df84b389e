#pragma once

#include <chrono>
#include <cstdint>
#include <deque>

namespace palpate {

/// Tick rate over the last second; 1/s. Not thread-safe.
class RateMeter {
 public:
  double see(std::uint64_t ticks) {
    seen_.push_back({Clock::now(), ticks});
    while (seen_.size() > 2 && seen_.back().time - seen_[1].time >= std::chrono::seconds(1))
      seen_.pop_front();
    const double passed_s = std::chrono::duration<double>(seen_.back().time - seen_.front().time).count();
    return passed_s > 0 ? static_cast<double>(seen_.back().ticks - seen_.front().ticks) / passed_s : 0;
  }

 private:
  using Clock = std::chrono::steady_clock;
  struct Sight {
    Clock::time_point time;
    std::uint64_t ticks;
  };
  std::deque<Sight> seen_;
};

}  // namespace palpate
