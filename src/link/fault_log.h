#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <string_view>

namespace palpate::link {

/// The faults of viewers, a line each: who, and of what kind, never what was sent. Of a flood only the first
/// lines of a second are written, and then how many there were.
class FaultLog {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr int kLinesEachSecond = 10;

  explicit FaultLog(std::function<void(const std::string&)> log) : log_(std::move(log)) {}

  void say(std::string_view who, std::string_view fault, Clock::time_point now = Clock::now());
  /// Writes what was left out in seconds that are over.
  void catch_up(Clock::time_point now = Clock::now());

 private:
  std::function<void(const std::string&)> log_;
  Clock::time_point begun_{};
  int lines_ = 0, left_out_ = 0;
};

}  // namespace palpate::link
