#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <string_view>

namespace palpate::server {

/// Log of viewers' faults, one line each: address and kind, never what was sent. In a flood only the first
/// lines of each second are written, followed by the number of omitted ones.
class FaultLog {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr int kLinesEachSecond = 10;

  explicit FaultLog(std::function<void(const std::string&)> log) : log_(std::move(log)) {}

  void add(std::string_view who, std::string_view fault, Clock::time_point now = Clock::now());
  /// Writes the number of lines omitted in past seconds.
  void catch_up(Clock::time_point now = Clock::now());

 private:
  std::function<void(const std::string&)> log_;
  Clock::time_point begun_{};
  int lines_ = 0, left_out_ = 0;
};

}  // namespace palpate::server
