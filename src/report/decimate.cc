#include "report/decimate.h"

#include <cmath>
#include <limits>

#include "palpate/check.h"

namespace palpate::report {
namespace {

/// Smallest and largest finite value of [first, end), in the order in which they occur.
std::pair<double, double> extremes(const std::vector<double>& values, std::size_t first, std::size_t end) {
  constexpr double kGap = std::numeric_limits<double>::quiet_NaN();
  std::size_t low = end, high = end;
  for (std::size_t i = first; i < end; ++i) {
    if (!std::isfinite(values[i])) continue;
    if (low == end || values[i] < values[low]) low = i;
    if (high == end || values[i] > values[high]) high = i;
  }
  if (low == end) return {kGap, kGap};
  return low < high ? std::pair{values[low], values[high]} : std::pair{values[high], values[low]};
}

}  // namespace

PlotData decimate(PlotData data, std::size_t most_points) {
  PALPATE_CHECK(most_points >= 2);
  const std::size_t n = data.x.size(), runs = most_points / 2;
  if (n <= most_points) return data;

  PlotData result;
  result.series.resize(data.series.size());
  for (std::size_t run = 0; run < runs; ++run) {
    // n > 2 runs, so that every run holds at least two samples and its two x differ
    const std::size_t first = run * n / runs, end = (run + 1) * n / runs;
    result.x.push_back(data.x[first]);
    result.x.push_back(data.x[first + (end - first) / 2]);
    for (std::size_t s = 0; s < data.series.size(); ++s) {
      const auto [earlier, later] = extremes(data.series[s], first, end);
      result.series[s].push_back(earlier);
      result.series[s].push_back(later);
    }
  }
  return result;
}

}  // namespace palpate::report
