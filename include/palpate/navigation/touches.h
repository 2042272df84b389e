#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "palpate/geometry/geometry.h"
#include "palpate/navigation/registration.h"

namespace palpate {

/// A point that was touched and held.
struct TouchedPoint {
  Point<Tracker> at;     ///< Mean of the tip positions while held
  double spread_mm = 0;  ///< RMS distance of these from the mean
  std::size_t poses = 0;
};

struct TouchSettings {
  double hold_s = 1;         ///< Minimum duration for which the tip is held
  double still_mm = 1;       ///< Maximum distance from the mean during that time
  double separation_mm = 5;  ///< Minimum distance from earlier touched points
  std::size_t fewest = 10;   ///< Minimum number of poses in that time
};

/// Detects points that are touched in sequence: each is recorded when the tip has been held still, and the
/// tip has to leave before the next one.
///
///     tip      moves ~~~~ held still ----|~~~~ moves ~~~ held still ----|
///     touch                              1                              2
class TouchDetector {
 public:
  enum class State {
    kMoving,   ///< Moving, or no pose at present
    kHeld,     ///< Still, but not long enough
    kTooNear,  ///< Still, but too near a point that was touched before
    kTaken,    ///< This pose has completed a point: taken().back()
  };

  explicit TouchDetector(const TouchSettings& settings = {}) : settings_(settings) {}

  /// Processes a tip position.
  /// @param time_s  of any clock, strictly increasing
  State observe(const Point<Tracker>& tip, double time_s);
  /// Removes the last recorded point, if any.
  void undo();
  const std::vector<TouchedPoint>& taken() const { return taken_; }

 private:
  struct Observed {
    Point<Tracker> tip;
    double time_s = 0;
  };
  const TouchSettings settings_;
  std::deque<Observed> samples_;  // samples of the last hold_s
  std::vector<TouchedPoint> taken_;
};

}  // namespace palpate
