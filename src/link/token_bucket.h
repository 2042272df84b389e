#pragma once

#include <algorithm>
#include <chrono>

namespace palpate::link {

/// So many a second on average, and no more than that many at once.
class TokenBucket {
 public:
  using Clock = std::chrono::steady_clock;

  explicit TokenBucket(double each_second) : each_second_(each_second), left_(each_second) {}

  /// False where there have been too many.
  bool take(Clock::time_point now) {
    const double passed_s = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    left_ = std::min(each_second_, left_ + passed_s * each_second_) - 1;
    return left_ >= 0;
  }

 private:
  double each_second_, left_;
  Clock::time_point last_ = Clock::now();
};

}  // namespace palpate::link
