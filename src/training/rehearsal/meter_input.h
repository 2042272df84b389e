#pragma once

#include "palpate/rehearsal/comparison.h"
#include "palpate/rehearsal/tool_head.h"

namespace palpate {

/// Input of the meters of a comparison for one tick.
struct MeterInput {
  RunPoint point;  ///< Position of the tip
  ToolHead head;
  double dt_s = 0;           ///< Time since the previous tick; 0 for the first
  std::size_t interval = 0;  ///< Interval of PlanComparison::times_s
  const DeviceTick* device = nullptr;
  std::optional<Vector<Patient>> shaft;  ///< From the tip to the handle; unit
};

}  // namespace palpate
