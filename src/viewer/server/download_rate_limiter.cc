#include "server/download_rate_limiter.h"

#include <algorithm>

namespace palpate::server {

DownloadRateLimiter::DownloadRateLimiter(std::size_t burst_bytes, Clock::time_point now)
    : burst_time_(time_of(burst_bytes)), paid_until_(now - burst_time_) {}

DownloadRateLimiter::Clock::duration DownloadRateLimiter::time_of(std::size_t bytes) {
  return std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(static_cast<double>(bytes) / kLimitedRate_bytes_per_s));
}

DownloadRateLimiter::Chunk DownloadRateLimiter::next(std::size_t left_bytes, bool is_only_viewer,
                                                     Clock::time_point now) {
  paid_until_ = std::max(paid_until_, now - burst_time_);
  const std::size_t large = std::min(left_bytes, kLargePart_bytes);
  if (paid_until_ + time_of(large) <= now) {
    paid_until_ += time_of(large);
    return {large, now};
  }
  // sends at full speed without accumulating credit or debt
  if (is_only_viewer) {
    paid_until_ = now;
    return {large, now};
  }
  const std::size_t small = std::min(left_bytes, kSmallPart_bytes);
  paid_until_ += time_of(small);
  return {small, std::max(paid_until_, now)};
}

}  // namespace palpate::server
