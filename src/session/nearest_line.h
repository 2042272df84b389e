#pragma once

#include <deque>
#include <map>
#include <span>
#include <vector>

#include "palpate/recording/recording.h"
#include "palpate/tissue/nearest.h"

namespace palpate {

/// How near burrs had come to what is protected (NearestMeter), up to any place of a recording.
class NearestLine {
 public:
  /// @param model  as NearestMeter takes it
  explicit NearestLine(const Model& model) : meter_(model) {}

  /// The next ticks, and what was told up to them, as the parts of a recording have it: either may be empty.
  void see(std::span<const TickRecord> ticks, std::span<const RecordingEvent> events);

  /// By label; right to kStep_mm, never too small.
  std::map<LabelId, double> at(double time_s) const;
  static constexpr double kStep_mm = 0.01;

 private:
  // it came nearer than it had been, by a step at least
  struct Nearer {
    double time_s;
    LabelId label;
    double mm;
  };
  NearestMeter meter_;
  std::deque<RecordingEvent> waiting_;  // of which no tick has heard yet
  std::map<LabelId, double> told_mm_;
  std::vector<Nearer> nearer_;
};

}  // namespace palpate
