#pragma once

#include <cstddef>
#include <vector>

namespace palpate::report {

/// Several series over one rising x. A value that is not finite is a gap.
struct PlotData {
  std::vector<double> x;
  std::vector<std::vector<double>> series;  ///< each as long as x
};

/// At most `most_points` (>= 2) points that look the same when drawn: the samples are cut into equal
/// runs, and of each run every series keeps its smallest and its largest value, in the order in which
/// they occur, at the run's first and middle x. No peak is lost; a value moves by less than one run. A
/// run that is nothing but gap stays a gap. Fewer samples come back as they are.
PlotData decimate(PlotData data, std::size_t most_points);

}  // namespace palpate::report
