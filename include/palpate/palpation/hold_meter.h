#pragma once

#include <cstdint>
#include <vector>

#include "palpate/palpation/palpation.h"

namespace palpate {

/// Structure to be held, with the forces that a script requests there; none: contact only.
struct HoldRequest {
  LabelId structure = 0;
  std::vector<double> forces_N = {};
};

/// Longest uninterrupted hold (HoldFigure::held_s), mean and peak force on one structure, accumulated from
/// every tick in order.
class HoldMeter {
 public:
  HoldMeter(const Model& model, const HoldRequest& hold);
  void observe(const TickRecord& record);
  HoldFigure figure() const;

 private:
  HoldFigure figure_;
  std::vector<double> forces_N_;    // requested forces; none: any force
  std::vector<double> unbroken_s_;  // duration of the current hold at each of them
  double sum_N_ = 0;
  std::uint64_t ticks_ = 0;
};

}  // namespace palpate
