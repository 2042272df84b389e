#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// Pass thresholds derived from runs of experts, and the discrimination of a metric between two groups.
namespace palpate {

/// Area under the receiver operating characteristic: the probability that a value of `worse` is worse than
/// one of `better`, with ties counted half. 0 ... 1; 0.5: no discrimination. NaN if either group is empty.
/// Unknown values (NaN) rank worst.
double area_under_curve(std::span<const double> better, std::span<const double> worse, bool more_is_better);

/// Pass threshold of a metric.
struct CutOff {
  double value = 0;
  std::array<double, 2> interval{};  ///< 95 % bootstrap interval
  std::string method;                ///< Description of the method
  /// Misclassification rates at the cut-off: fraction of experts who fail, and of novices who pass. Empty
  /// without novices.
  std::optional<double> experts_below, novices_above;
  /// Whether both groups have at least kEnoughRuns runs, so that the interval is meaningful; otherwise "not
  /// validated"
  bool has_enough_runs = false;
};

/// Parameters of cut_off().
struct CalibrationOptions {
  double fraction = 0.9;  ///< Fraction of the experts' runs that should pass, 0.5 ... 0.99
  int resamples = 2000;
  std::uint64_t seed = 1;
};
/// Minimum number of runs per group for a meaningful interval.
inline constexpr std::size_t kEnoughRuns = 10;

/// Computes the pass threshold of a metric. Without novices it is the value that a fraction `fraction` of the
/// experts' runs reaches (quantile by linear interpolation, definition 7 of Hyndman and Fan). With novices it
/// follows the contrasting-groups method: the intersection, between the means, of normal densities fitted to
/// both groups. The interval is a percentile bootstrap with `resamples` resamples of the runs.
/// Errors: kBadInput for fewer than 3 runs in a group, runs without the metric, or groups whose means are in
/// the wrong order.
Result<CutOff> cut_off(std::span<const double> experts, std::span<const double> novices, bool more_is_better,
                       const CalibrationOptions& options = {});

}  // namespace palpate
