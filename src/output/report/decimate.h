#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace palpate::report {

/// Marks a missing value of a series.
inline constexpr double kGap = std::numeric_limits<double>::quiet_NaN();

/// Several series over one ascending x. Non-finite values are gaps.
struct PlotData {
  std::vector<double> x;
  std::vector<std::vector<double>> series;  ///< Same length as x
};

/// Min-max decimation to at most `max_points` (>= 2) points, which looks the same when plotted: the samples
/// are divided into equal intervals, and in each of them every series keeps its minimum and maximum, in the
/// order of their occurrence, at the first and middle x of the interval. Peaks are preserved; a value is
/// shifted by less than one interval. An interval that consists only of gaps stays a gap. Fewer samples are
/// returned unchanged.
class Decimator {
 public:
  Decimator(std::size_t samples, std::size_t series, std::size_t max_points);
  /// Adds the next sample; exactly `samples` of them are expected.
  void add(double x, std::span<const double> values);
  /// Call after the last sample.
  PlotData finish();

 private:
  // minimum and maximum of the current interval; a gap if there is none
  struct Extremes {
    double low, high;
    bool low_first = true;
  };
  void begin_interval();
  void end_interval();

  std::size_t samples_, intervals_;  // intervals_ 0: every sample is kept
  std::size_t taken_ = 0, interval_ = 0, interval_first_ = 0, interval_end_ = 0;
  std::vector<Extremes> extremes_;
  PlotData data_;
};

}  // namespace palpate::report
