#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

/// Six-digit code by which a page re-arms a physical device. It is displayed where palpate runs and is valid
/// for one rearm after one stop, so that whoever enters it is in touch with somebody who sees the device.
///
///    shown() ── code for this stop, valid for kLasts ──► take() ── correct: used up
///                                                            └─ kMaxWrong wrong ones: none for kPause
///
/// At kMaxWrong guesses per kPause, each at a fresh code, a guesser needs 27 days for an even chance.
/// Thread-safe.
class ArmingCode {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kLasts{60}, kPause{10};
  static constexpr int kMaxWrong = 3;

  /// Code for this stop; empty if none is available.
  std::string shown(std::uint32_t stop, Clock::time_point now = Clock::now());
  /// Checks a code; a correct one is used up.
  bool take(std::uint32_t stop, std::string_view code, Clock::time_point now = Clock::now());

 private:
  std::mutex mutex_;
  std::string code_;  // empty: no valid code
  std::uint32_t stop_ = 0;
  int wrong_ = 0;
  Clock::time_point until_{}, paused_until_{};
};

}  // namespace palpate
