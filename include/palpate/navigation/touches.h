#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "palpate/geometry/geometry.h"
#include "palpate/navigation/registration.h"

namespace palpate {

/// A place that was touched.
struct HeldPlace {
  Point<Tracker> at;   ///< mean of the tip's places while it was held
  double held_mm = 0;  ///< root of the mean square distance of those from it
  std::size_t poses = 0;
};

struct TouchSettings {
  double hold_s = 1;        ///< so long the tip is held for a touch
  double still_mm = 1;      ///< in all that time it is no farther from its mean
  double apart_mm = 5;      ///< so far from the places before a touch has to be
  std::size_t fewest = 10;  ///< poses in that time
};

/// Takes places that are touched one after the other: each when the tip has been held still. Before the next
/// one it has to leave.
///
///     tip      moves ~~~~ held still ----|~~~~ moves ~~~ held still ----|
///     touch                              1                              2
class TouchTaker {
 public:
  enum class State {
    kMoving,   ///< or no pose at present
    kHeld,     ///< still, and not long enough
    kTooNear,  ///< still, where a place was touched before
    kTaken,    ///< this pose has completed one: taken().back()
  };

  explicit TouchTaker(const TouchSettings& settings = {}) : settings_(settings) {}

  /// Where the tip is. @param time_s  of any clock, later than the last one's
  State see(const Point<Tracker>& tip, double time_s);
  /// Forgets the last place that was taken; none: does nothing.
  void undo();
  const std::vector<HeldPlace>& taken() const { return taken_; }

 private:
  struct Seen {
    Point<Tracker> tip;
    double time_s = 0;
  };
  const TouchSettings settings_;
  std::deque<Seen> seen_;  // of the last hold_s
  std::vector<HeldPlace> taken_;
};

}  // namespace palpate
