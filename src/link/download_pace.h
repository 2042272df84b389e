#pragma once

#include <chrono>
#include <cstddef>

namespace palpate::link {

/// How fast volumes go out, all downloads of a server together. What is sent costs the servo time that no
/// priority gives back: the kernel handles packets where it happens to be, before any thread. So where there
/// are several viewers only as much as one of them loads goes as fast as it can; what is more goes in small
/// parts, at a rate that leaves the servo its time, and each download gets its turn. What was not used comes
/// back at that rate. One viewer alone never waits. All times are the caller's.
class DownloadPace {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr double kEachSecond_bytes = 8e6;
  /// Parts, in a hurry and not.
  static constexpr std::size_t kLargePart_bytes = 64 << 10, kSmallPart_bytes = 16 << 10;

  /// @param at_once_bytes  that go as fast as they can, when none have gone for a while
  DownloadPace(std::size_t at_once_bytes, Clock::time_point now);

  struct Turn {
    std::size_t bytes = 0;
    Clock::time_point at;  ///< not before
  };
  /// The next part of a download, which has sent the one before.
  /// @param left_bytes  of it, at least one
  /// @param alone       whether no more is loaded than what one viewer loads
  Turn next(std::size_t left_bytes, bool alone, Clock::time_point now);

 private:
  static Clock::duration time_of(std::size_t bytes);

  const Clock::duration at_once_;
  Clock::time_point paid_until_;  // when all that was sent would have gone at the rate alone
};

}  // namespace palpate::link
