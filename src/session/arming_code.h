#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

/// Six digits by which a page arms a physical device: shown where palpate runs, and good for one rearm after
/// one stop. Whoever types them has somebody's word who sees the device.
///
///     shown() ── a code of this stop, for kLasts ──► take() ── right: used up
///                                                     └─ kMostWrong wrong ones: none for kPause
///
/// With kMostWrong guesses each kPause, at a code that is another one each time, a guesser needs 27 days for
/// an even chance. Any thread.
class ArmingCode {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kLasts{60}, kPause{10};
  static constexpr int kMostWrong = 3;

  /// The code that answers this stop; empty while there is none to be had.
  std::string shown(std::uint32_t stop, Clock::time_point now = Clock::now());
  /// Whether it is the one that was shown. It is used up then.
  bool take(std::uint32_t stop, std::string_view code, Clock::time_point now = Clock::now());

 private:
  std::mutex mutex_;
  std::string code_;  // empty: none
  std::uint32_t stop_ = 0;
  int wrong_ = 0;
  Clock::time_point until_{}, paused_until_{};
};

}  // namespace palpate
