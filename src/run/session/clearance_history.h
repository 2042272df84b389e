#pragma once

#include <deque>
#include <map>
#include <span>
#include <vector>

#include "palpate/recording/recording.h"
#include "palpate/tissue/protected_distance.h"

namespace palpate {

/// Smallest distance between burrs and protected structures (ProtectedDistanceMeter) up to any time of a
/// recording.
class ClearanceHistory {
 public:
  /// @param model  as for ProtectedDistanceMeter
  explicit ClearanceHistory(const Model& model) : meter_(model) {}

  /// Adds the next ticks and the events before them, as a part of a recording has them; either may be empty.
  void observe(std::span<const TickRecord> ticks, std::span<const RecordingEvent> events);

  /// Distance by label; accurate to kStep_mm, never too small.
  std::map<LabelId, double> at(double time_s) const;
  static constexpr double kStep_mm = 0.01;

 private:
  // new minimum, at least a step below the previous one
  struct Nearer {
    double time_s;
    LabelId label;
    double mm;
  };
  ProtectedDistanceMeter meter_;
  std::deque<RecordingEvent> waiting_;  // events that have not taken effect with a tick yet
  std::map<LabelId, double> reported_mm_;
  std::vector<Nearer> nearer_;
};

}  // namespace palpate
