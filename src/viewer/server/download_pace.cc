#include "server/download_pace.h"

#include <algorithm>

namespace palpate::server {

DownloadPace::DownloadPace(std::size_t at_once_bytes, Clock::time_point now)
    : at_once_(time_of(at_once_bytes)), paid_until_(now - at_once_) {}

DownloadPace::Clock::duration DownloadPace::time_of(std::size_t bytes) {
  return std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(static_cast<double>(bytes) / kEachSecond_bytes));
}

DownloadPace::Turn DownloadPace::next(std::size_t left_bytes, bool alone, Clock::time_point now) {
  paid_until_ = std::max(paid_until_, now - at_once_);
  const std::size_t large = std::min(left_bytes, kLargePart_bytes);
  if (paid_until_ + time_of(large) <= now) {
    paid_until_ += time_of(large);
    return {large, now};
  }
  // sends at full speed without accumulating credit or debt
  if (alone) {
    paid_until_ = now;
    return {large, now};
  }
  const std::size_t small = std::min(left_bytes, kSmallPart_bytes);
  paid_until_ += time_of(small);
  return {small, std::max(paid_until_, now)};
}

}  // namespace palpate::server
