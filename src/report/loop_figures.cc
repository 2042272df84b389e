#include "report/loop_figures.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::report {

Spread spread_of(std::vector<double> values_s) {
  std::erase_if(values_s, [](double value) { return !std::isfinite(value); });
  std::ranges::sort(values_s);
  const auto at = [&](double part) {
    if (values_s.empty()) return std::numeric_limits<double>::quiet_NaN();
    // the smallest value that at least this part of all do not exceed
    const double rank = std::ceil(part * static_cast<double>(values_s.size()));
    return values_s[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
  };
  return {at(0.5), at(0.99), at(0.999), at(1)};
}

double measured_rate_hz(const Recording& recording, const std::vector<double>& edges_s) {
  const std::vector<TickRecord>& ticks = recording.ticks;
  if (ticks.size() < 2) return std::numeric_limits<double>::quiet_NaN();
  const double computed = static_cast<double>(ticks.back().tick) - static_cast<double>(ticks.front().tick);
  return computed / (edges_s[ticks.size() - 1] - edges_s.front());
}

}  // namespace palpate::report
