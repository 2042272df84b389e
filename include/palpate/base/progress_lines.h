#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

/// Selects which progress reports are written as lines where no progress bar can be drawn (a log, a pipe). A
/// new stage gets a line unless the previous line is less than two seconds old, a stage that continues gets
/// one every ten seconds, and work that finishes within two seconds gets none.
class ProgressLines {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit ProgressLines(Time begun) : last_(begun) {}
  /// Line to write now, without a line feed ("smoothing 42 %"), or nullopt.
  std::optional<std::string> line(std::string_view stage, double fraction, Time now);

 private:
  std::string stage_;  // stage of the last line
  Time last_;          // time of the last line; initially the start of the work
};

}  // namespace palpate
