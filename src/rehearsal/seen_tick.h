#pragma once

#include "palpate/rehearsal/comparison.h"
#include "rehearsal/tool_head.h"

namespace palpate {

/// A tick as the meters of a comparison see it.
struct SeenTick {
  PlaceInRun place;  ///< of the tip
  ToolHead head;
  double dt_s = 0;       ///< since the tick before, 0 of the first
  std::size_t part = 0;  ///< of PlanComparison::times_s
  const DeviceTick* device = nullptr;
  std::optional<Vector<Patient>> shaft;  ///< from the tip to the handle, unit
};

}  // namespace palpate
