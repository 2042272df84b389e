#pragma once

#include <chrono>
#include <cstdint>
#include <deque>

namespace palpate {

/// Tick rate over the last second; 1/s. Not thread-safe.
class RateMeter {
 public:
  double observe(std::uint64_t ticks) {
    samples_.push_back({Clock::now(), ticks});
    while (samples_.size() > 2 && samples_.back().time - samples_[1].time >= std::chrono::seconds(1))
      samples_.pop_front();
    const double passed_s =
        std::chrono::duration<double>(samples_.back().time - samples_.front().time).count();
    return passed_s > 0 ? static_cast<double>(samples_.back().ticks - samples_.front().ticks) / passed_s : 0;
  }

 private:
  using Clock = std::chrono::steady_clock;
  struct Sample {
    Clock::time_point time;
    std::uint64_t ticks;
  };
  std::deque<Sample> samples_;
};

}  // namespace palpate
