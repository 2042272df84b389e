#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace palpate::report {

/// Where a series has no value.
inline constexpr double kGap = std::numeric_limits<double>::quiet_NaN();

/// Several series over one rising x. A value that is not finite is a gap.
struct PlotData {
  std::vector<double> x;
  std::vector<std::vector<double>> series;  ///< each as long as x
};

/// At most `max_points` (>= 2) points that look the same when drawn: the samples are cut into equal
/// runs, and of each run every series keeps its smallest and its largest value, in the order in which
/// they occur, at the run's first and middle x. No peak is lost; a value moves by less than one run. A
/// run that is nothing but gap stays a gap. Fewer samples come back as they are.
class Decimator {
 public:
  Decimator(std::size_t samples, std::size_t series, std::size_t max_points);
  /// The next sample; as many as were told.
  void add(double x, std::span<const double> values);
  /// After the last one.
  PlotData finish();

 private:
  // the extremes of a run so far; a gap where there is none
  struct Extremes {
    double low, high;
    bool low_first = true;
  };
  void begin_run();
  void end_run();

  std::size_t samples_, runs_;  // runs_ 0: every sample is kept
  std::size_t taken_ = 0, run_ = 0, run_first_ = 0, run_end_ = 0;
  std::vector<Extremes> extremes_;
  PlotData data_;
};

}  // namespace palpate::report
