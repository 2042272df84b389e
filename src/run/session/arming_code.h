#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

/// Six-digit code by which a page re-arms a physical device. It is displayed where palpate runs and is valid
/// for one rearm after one stop, so that only someone in contact with a person at the device can enter it.
///
///    code_for() ── code for this stop, valid for kValidity ──► redeem() ── correct: used up
///                                                                 └─ kMaxWrongGuesses wrong ones: none for
///                                                                 kLockout
///
/// At kMaxWrongGuesses guesses per kLockout, each at a fresh code, a guesser needs 27 days for an even
/// chance. Thread-safe.
class ArmingCode {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kValidity{60}, kLockout{10};
  static constexpr int kMaxWrongGuesses = 3;

  /// Code for this stop; empty if none is available.
  std::string code_for(std::uint32_t stop, Clock::time_point now = Clock::now());
  /// Checks a code; a correct one is used up.
  bool redeem(std::uint32_t stop, std::string_view code, Clock::time_point now = Clock::now());

 private:
  std::mutex mutex_;
  std::string code_;  // empty: no valid code
  std::uint32_t stop_ = 0;
  int wrong_ = 0;
  Clock::time_point until_{}, paused_until_{};
};

}  // namespace palpate
