#include "palpate/navigation/touches.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// maximum gap in tracking for which the tip still counts as held
constexpr double kMaxGap_s = 0.25;

}  // namespace

TouchDetector::State TouchDetector::observe(const Point<Tracker>& tip, double time_s) {
  if (!observed_.empty() && time_s - observed_.back().time_s > kMaxGap_s) observed_.clear();
  observed_.push_back({tip, time_s});
  // keep the last sample older than hold_s: the tip has been held since then
  while (observed_.size() > 1 && time_s - observed_[1].time_s >= settings_.hold_s) observed_.pop_front();

  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Observed& each : observed_) mean += each.tip.eigen() / static_cast<double>(observed_.size());
  TouchedPoint place{Point<Tracker>(mean), 0, observed_.size()};
  double most = 0, squares = 0;
  for (const Observed& each : observed_) {
    const double away = (each.tip - place.at).norm();
    most = std::max(most, away);
    squares += away * away / static_cast<double>(observed_.size());
  }
  place.held_mm = std::sqrt(squares);
  // after a movement the hold restarts, so that a touch excludes the approach
  if (most > settings_.still_mm) {
    observed_.erase(observed_.begin(), observed_.end() - 1);
    return State::kMoving;
  }
  const auto is_near = [&](const TouchedPoint& before) {
    return (before.at - place.at).norm() < settings_.apart_mm;
  };
  if (std::any_of(taken_.begin(), taken_.end(), is_near)) return State::kTooNear;
  if (time_s - observed_.front().time_s < settings_.hold_s || observed_.size() < settings_.fewest)
    return State::kHeld;
  taken_.push_back(place);
  observed_.clear();
  return State::kTaken;
}

void TouchDetector::undo() {
  if (taken_.empty()) return;
  taken_.pop_back();
  observed_.clear();
}

}  // namespace palpate
