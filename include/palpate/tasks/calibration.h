#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// Cut-offs from runs of experts, and how well a figure tells two groups apart.
namespace palpate {

/// Probability that a figure of `worse` is worse than one of `better`, ties by half: the area under the
/// receiver operating characteristic, 0 ... 1; 0.5 says nothing. NaN where either is empty. Values that are
/// not known count as the worst.
double area_under_curve(std::span<const double> better, std::span<const double> worse, bool more_is_better);

struct CutOff {
  double value = 0;
  std::array<double, 2> interval{};  ///< 95 %, by bootstrap
  std::string method;                ///< in words
  /// Of the groups by the cut-off; with novices alone.
  std::optional<double> experts_below, novices_above;
  bool is_enough = false;  ///< so many runs that the interval means something; else "not validated"
};

struct CalibrationOptions {
  double share = 0.9;  ///< of experts' runs that pass, 0.5 ... 0.99
  int resamples = 2000;
  std::uint64_t seed = 1;
};
/// Runs below which a cut-off says so of itself.
inline constexpr std::size_t kEnoughRuns = 10;

/// Without novices the value that `share` of the experts' runs reach (quantile by linear interpolation,
/// Hyndman and Fan's 7th definition). With novices that of contrasting groups: where the two normal densities
/// of both groups cross between their means. Intervals by 2000 resamples of runs (percentile bootstrap).
/// Errors: kBadInput for fewer than 3 runs of a group, runs without that figure, groups whose means are the
/// wrong way around.
Result<CutOff> cut_off(std::span<const double> experts, std::span<const double> novices, bool more_is_better,
                       const CalibrationOptions& options = {});

}  // namespace palpate
