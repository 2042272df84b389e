#pragma once

#include <chrono>
#include <cstddef>

namespace palpate::server {

/// Rate limiter shared by all volume downloads of a server. Network traffic costs servo time that thread
/// priorities cannot prevent, because the kernel handles packets in interrupt context on whatever CPU it
/// runs. With several viewers, therefore, only as many bytes as one viewer downloads are sent at full speed;
/// the rest is sent in small parts, at a rate that leaves the servo its time, with the downloads taking
/// turns. Unused capacity accumulates at that rate. A single viewer is never delayed. All times are supplied
/// by the caller.
class DownloadRateLimiter {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr double kLimitedRate_bytes_per_s = 8e6;
  /// Part sizes at full speed and at the limited rate.
  static constexpr std::size_t kLargePart_bytes = 64 << 10, kSmallPart_bytes = 16 << 10;

  /// @param burst_bytes  bytes sent at full speed after a period without downloads
  DownloadRateLimiter(std::size_t burst_bytes, Clock::time_point now);

  struct Chunk {
    std::size_t bytes = 0;
    Clock::time_point not_before;  ///< Earliest time of sending
  };
  /// Next part of a download whose previous part has been sent.
  /// @param left_bytes      remaining bytes, at least one
  /// @param is_only_viewer  whether there is at most one viewer, with no more downloads than it needs
  Chunk next(std::size_t left_bytes, bool is_only_viewer, Clock::time_point now);

 private:
  static Clock::duration time_of(std::size_t bytes);

  const Clock::duration burst_time_;
  // time by which everything sent so far would have been sent at the limited rate
  Clock::time_point paid_until_;
};

}  // namespace palpate::server
