#pragma once

#include <chrono>
#include <cstdint>
#include <deque>

namespace palpate {

/// Tick rate over the last second; 1/s. Not thread-safe.
class RateMeter {
 public:
  double observe(std::uint64_t ticks) {
    observed_.push_back({Clock::now(), ticks});
    while (observed_.size() > 2 && observed_.back().time - observed_[1].time >= std::chrono::seconds(1))
      observed_.pop_front();
    const double passed_s =
        std::chrono::duration<double>(observed_.back().time - observed_.front().time).count();
    return passed_s > 0 ? static_cast<double>(observed_.back().ticks - observed_.front().ticks) / passed_s
                        : 0;
  }

 private:
  using Clock = std::chrono::steady_clock;
  struct Sight {
    Clock::time_point time;
    std::uint64_t ticks;
  };
  std::deque<Sight> observed_;
};

}  // namespace palpate
