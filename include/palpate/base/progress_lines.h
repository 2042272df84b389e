#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

/// Where no bar can be drawn (a log, a pipe): which of many reports are worth a line of their own. A stage
/// that begins gets one, unless the last is less than two seconds ago, and what takes long one each ten
/// seconds; what is done within two seconds stays silent.
class ProgressLines {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit ProgressLines(Time begun) : last_(begun) {}
  /// The line to write now, without its end: "smoothing 42 %"; or nothing.
  std::optional<std::string> line(std::string_view stage, double fraction, Time now);

 private:
  std::string stage_;  // of the last line
  Time last_;          // when it was written; at first the beginning
};

}  // namespace palpate
