#include "palpate/tasks/calibration.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

namespace palpate {
namespace {

double quantile(std::vector<double> values, double fraction) {
  std::sort(values.begin(), values.end());
  const double at = fraction * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  if (below + 1 >= values.size()) return values.back();
  return values[below] + (at - static_cast<double>(below)) * (values[below + 1] - values[below]);
}

struct Normal {
  double mean, sd;
};
Normal normal_of(const std::vector<double>& values) {
  const auto n = static_cast<double>(values.size());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double squares = 0;
  for (const double value : values) squares += (value - mean) * (value - mean);
  return {mean, std::sqrt(squares / (n - 1))};
}

/// Intersection of two normal densities between their means; the midpoint if either group has no spread.
double crossing(const Normal& a, const Normal& b) {
  if (!(a.sd > 0) || !(b.sd > 0)) return 0.5 * (a.mean + b.mean);
  const auto difference = [&](double x) {
    const double u = (x - a.mean) / a.sd, v = (x - b.mean) / b.sd;
    return 0.5 * (v * v - u * u) + std::log(b.sd / a.sd);
  };
  double low = std::min(a.mean, b.mean), high = std::max(a.mean, b.mean);
  const double at_low = difference(low);
  // with very different spreads the densities may not intersect between the means
  if ((at_low > 0) == (difference(high) > 0)) return 0.5 * (a.mean + b.mean);
  for (int turn = 0; turn < 200; ++turn) {
    const double midpoint = 0.5 * (low + high);
    ((difference(midpoint) > 0) == (at_low > 0) ? low : high) = midpoint;
  }
  return 0.5 * (low + high);
}

}  // namespace

double area_under_curve(std::span<const double> better, std::span<const double> worse, bool more_is_better) {
  if (better.empty() || worse.empty()) return std::numeric_limits<double>::quiet_NaN();
  // ascending from good to bad; unknown values are worst
  const auto badness = [&](double value) {
    if (std::isnan(value)) return std::numeric_limits<double>::infinity();
    return more_is_better ? -value : value;
  };
  double won = 0;
  for (const double w : worse)
    for (const double b : better) won += badness(w) > badness(b) ? 1 : badness(w) == badness(b) ? 0.5 : 0;
  return won / (static_cast<double>(better.size()) * static_cast<double>(worse.size()));
}

Result<CutOff> cut_off(std::span<const double> experts, std::span<const double> novices, bool more_is_better,
                       const CalibrationOptions& options) {
  constexpr std::size_t kMinRuns = 3;
  const auto unusable = [](std::span<const double> values) {
    return std::any_of(values.begin(), values.end(), [](double value) { return !std::isfinite(value); });
  };
  if (unusable(experts) || unusable(novices))
    return Error{ErrorKind::kBadInput, "a run has no value of this metric", "",
                 "leave that run or that metric out"};
  if (experts.size() < kMinRuns || (!novices.empty() && novices.size() < kMinRuns))
    return Error{ErrorKind::kBadInput,
                 "a cut-off of " +
                     std::to_string(experts.size() < kMinRuns ? experts.size() : novices.size()) + " runs",
                 "", "give at least 3 runs of each group; the interval is meaningful from 10 on"};
  const auto from = [&](const std::vector<double>& good, const std::vector<double>& bad) {
    if (!bad.empty()) return crossing(normal_of(good), normal_of(bad));
    return quantile(good, more_is_better ? 1 - options.fraction : options.fraction);
  };
  const std::vector<double> good(experts.begin(), experts.end()), bad(novices.begin(), novices.end());
  if (!bad.empty()) {
    const double a = normal_of(good).mean, b = normal_of(bad).mean;
    if (more_is_better ? a <= b : a >= b)
      return Error{ErrorKind::kBadInput, "the novices' mean is no worse than the experts'", "",
                   "the metric does not distinguish the groups, or in the wrong direction: do not count it"};
  }
  CutOff found;
  found.value = from(good, bad);
  found.has_enough_runs = good.size() >= kEnoughRuns && (bad.empty() || bad.size() >= kEnoughRuns);
  found.method = bad.empty()
                     ? "what " + std::to_string(static_cast<int>(std::lround(100 * options.fraction))) +
                           " % of the experts' runs reach"
                     : "contrasting groups: where both groups' normal densities cross";

  std::mt19937_64 random(options.seed);
  const auto resample = [&](const std::vector<double>& values) {
    std::vector<double> drawn(values.size());
    for (double& value : drawn) value = values[random() % values.size()];
    return drawn;
  };
  std::vector<double> values;
  values.reserve(static_cast<std::size_t>(options.resamples));
  for (int n = 0; n < options.resamples; ++n) {
    const auto some_good = resample(good);
    values.push_back(from(some_good, resample(bad)));
  }
  found.interval = {quantile(values, 0.025), quantile(values, 0.975)};
  if (!bad.empty()) {
    const auto passes = [&](double value) {
      return more_is_better ? value >= found.value : value <= found.value;
    };
    const auto fraction = [&](const std::vector<double>& group, bool passing) {
      return static_cast<double>(std::count_if(group.begin(), group.end(),
                                               [&](double value) { return passes(value) == passing; })) /
             static_cast<double>(group.size());
    };
    found.experts_below = fraction(good, false);
    found.novices_above = fraction(bad, true);
  }
  return found;
}

}  // namespace palpate
