#include "palpate/navigation/touches.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// maximum gap in tracking for which the tip still counts as held
constexpr double kMaxGap_s = 0.25;

}  // namespace

TouchDetector::State TouchDetector::observe(const Point<Tracker>& tip, double time_s) {
  if (!samples_.empty() && time_s - samples_.back().time_s > kMaxGap_s) samples_.clear();
  samples_.push_back({tip, time_s});
  // keep the last sample older than hold_s: the tip has been held since then
  while (samples_.size() > 1 && time_s - samples_[1].time_s >= settings_.hold_s) samples_.pop_front();

  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Observed& each : samples_) mean += each.tip.eigen() / static_cast<double>(samples_.size());
  TouchedPoint point{Point<Tracker>(mean), 0, samples_.size()};
  double largest = 0, squares = 0;
  for (const Observed& each : samples_) {
    const double away = (each.tip - point.at).norm();
    largest = std::max(largest, away);
    squares += away * away / static_cast<double>(samples_.size());
  }
  point.spread_mm = std::sqrt(squares);
  // after a movement the hold restarts, so that a touch excludes the approach
  if (largest > settings_.still_mm) {
    samples_.erase(samples_.begin(), samples_.end() - 1);
    return State::kMoving;
  }
  const auto is_near = [&](const TouchedPoint& before) {
    return (before.at - point.at).norm() < settings_.separation_mm;
  };
  if (std::any_of(taken_.begin(), taken_.end(), is_near)) return State::kTooNear;
  if (time_s - samples_.front().time_s < settings_.hold_s || samples_.size() < settings_.fewest)
    return State::kHeld;
  taken_.push_back(point);
  samples_.clear();
  return State::kTaken;
}

void TouchDetector::undo() {
  if (taken_.empty()) return;
  taken_.pop_back();
  samples_.clear();
}

}  // namespace palpate
