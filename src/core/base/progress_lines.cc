#include <algorithm>
#include <cmath>

#include "palpate/base/progress_lines.h"

namespace palpate {

std::optional<std::string> ProgressLines::line(std::string_view stage, double fraction, Time now) {
  constexpr auto kNewStage = std::chrono::seconds(2), kSameStage = std::chrono::seconds(10);
  // the start of the next stage implies the end of this one
  if (fraction >= 1 || now - last_ < (stage == stage_ ? kSameStage : kNewStage)) return std::nullopt;
  stage_ = stage;
  last_ = now;
  const double part = std::isfinite(fraction) ? std::clamp(fraction, 0.0, 1.0) : 0;
  return stage_ + " " + std::to_string(static_cast<int>(100 * part)) + " %";
}

}  // namespace palpate
