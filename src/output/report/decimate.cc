#include "report/decimate.h"

#include <cmath>
#include <limits>
#include <utility>

#include "palpate/base/check.h"

namespace palpate::report {
Decimator::Decimator(std::size_t samples, std::size_t series, std::size_t max_points)
    : samples_(samples), intervals_(samples <= max_points ? 0 : max_points / 2), extremes_(series) {
  PALPATE_CHECK(max_points >= 2);
  data_.series.resize(series);
  if (intervals_ > 0) begin_interval();
}

void Decimator::begin_interval() {
  // there are more than two samples per interval on average, so every interval has at least two with
  // different x
  interval_first_ = interval_ * samples_ / intervals_;
  interval_end_ = (interval_ + 1) * samples_ / intervals_;
  for (Extremes& extremes : extremes_) extremes = {kGap, kGap};
}

void Decimator::end_interval() {
  for (std::size_t s = 0; s < extremes_.size(); ++s) {
    const Extremes& of = extremes_[s];
    data_.series[s].push_back(of.low_first ? of.low : of.high);
    data_.series[s].push_back(of.low_first ? of.high : of.low);
  }
  if (++interval_ < intervals_) begin_interval();
}

void Decimator::add(double x, std::span<const double> values) {
  PALPATE_CHECK(values.size() == extremes_.size() && taken_ < samples_);
  const std::size_t sample = taken_++;
  if (intervals_ == 0) {
    data_.x.push_back(x);
    for (std::size_t s = 0; s < values.size(); ++s) data_.series[s].push_back(values[s]);
    return;
  }
  if (sample == interval_first_ || sample == interval_first_ + (interval_end_ - interval_first_) / 2)
    data_.x.push_back(x);
  for (std::size_t s = 0; s < values.size(); ++s) {
    if (!std::isfinite(values[s])) continue;
    Extremes& of = extremes_[s];
    const bool first = std::isnan(of.low);
    // low_first records which extreme occurred first; a single value is both
    if (first || values[s] > of.high) of.high = values[s], of.low_first = true;
    if (first || values[s] < of.low) of.low = values[s], of.low_first = first;
  }
  if (taken_ == interval_end_) end_interval();
}

PlotData Decimator::finish() {
  PALPATE_CHECK(taken_ == samples_);
  return std::move(data_);
}

}  // namespace palpate::report
