#include "palpate/navigation/touches.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// maximum gap in tracking for which the tip still counts as held
constexpr double kMaxGap_s = 0.25;

}  // namespace

TouchDetector::State TouchDetector::see(const Point<Tracker>& tip, double time_s) {
  if (!seen_.empty() && time_s - seen_.back().time_s > kMaxGap_s) seen_.clear();
  seen_.push_back({tip, time_s});
  // keep the last sample older than hold_s: the tip has been held since then
  while (seen_.size() > 1 && time_s - seen_[1].time_s >= settings_.hold_s) seen_.pop_front();

  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Seen& each : seen_) mean += each.tip.eigen() / static_cast<double>(seen_.size());
  TouchedPoint place{Point<Tracker>(mean), 0, seen_.size()};
  double most = 0, squares = 0;
  for (const Seen& each : seen_) {
    const double away = (each.tip - place.at).norm();
    most = std::max(most, away);
    squares += away * away / static_cast<double>(seen_.size());
  }
  place.held_mm = std::sqrt(squares);
  // after a movement the hold restarts, so that a touch excludes the approach
  if (most > settings_.still_mm) {
    seen_.erase(seen_.begin(), seen_.end() - 1);
    return State::kMoving;
  }
  const auto is_near = [&](const TouchedPoint& before) {
    return (before.at - place.at).norm() < settings_.apart_mm;
  };
  if (std::any_of(taken_.begin(), taken_.end(), is_near)) return State::kTooNear;
  if (time_s - seen_.front().time_s < settings_.hold_s || seen_.size() < settings_.fewest)
    return State::kHeld;
  taken_.push_back(place);
  seen_.clear();
  return State::kTaken;
}

void TouchDetector::undo() {
  if (taken_.empty()) return;
  taken_.pop_back();
  seen_.clear();
}

}  // namespace palpate
