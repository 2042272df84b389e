#pragma once

#include <algorithm>
#include <chrono>

namespace palpate::server {

/// Token bucket: rate limit with a bounded burst.
class TokenBucket {
 public:
  using Clock = std::chrono::steady_clock;

  /// Initially full.
  TokenBucket(double rate_per_s, double burst, Clock::time_point now)
      : rate_per_s_(rate_per_s), burst_(burst), left_(burst), last_(now) {}

  /// Number of tokens available.
  double left(Clock::time_point now) const {
    const double passed_s = std::max(std::chrono::duration<double>(now - last_).count(), 0.0);
    return std::min(burst_, left_ + passed_s * rate_per_s_);
  }
  /// Whether the bucket is in its initial state.
  bool is_full(Clock::time_point now) const { return left(now) >= burst_; }
  /// Takes a token; false if none is available.
  bool take(Clock::time_point now) {
    left_ = left(now);
    last_ = std::max(last_, now);
    if (left_ < 1) return false;
    left_ -= 1;
    return true;
  }

 private:
  double rate_per_s_, burst_, left_;
  Clock::time_point last_;
};

}  // namespace palpate::server
