#pragma once

#include <memory>

#include "palpate/base/result.h"
#include "palpate/haptics/haptics.h"

/// What a tick makes of soft tissue that is solved beside it (YieldSolver), along ways that a tool is led.
namespace palpate {

/// A block of 10 kPa on a plate 24 mm below its surface, z = 0, voxels of 1 mm; with a nodule 8 mm wide and
/// 10 times as stiff, 5 mm deep at x = y = 0, or without. Ready for the proxy; a tool of 3 mm radius.
Result<std::shared_ptr<const Model>> yielding_block(bool nodule, TissueLaw law = TissueLaw::kElastic);

/// How far the tick's force was from that of a solution which has converged at the same place.
struct TickOff {
  double largest_percent = 0, mean_percent = 0;  ///< of the way's peak
  double peak_N = 0;
  int samples = 0;
};
/// Pressed at a speed to 4 mm, at `x_mm`.
TickOff press_tissue(const std::shared_ptr<const Model>& model, double speed_mm_s, double x_mm);
/// Slid at a speed 3 mm deep, from x = -18 mm to 18 mm.
TickOff slide_on_tissue(const std::shared_ptr<const Model>& model, double speed_mm_s);
/// Held still 4 mm deep from 0.1 s after it came to rest on: the greatest change of the force in a tick, N.
double change_at_rest_N(const std::shared_ptr<const Model>& model);
/// Pressed 3 mm in, slid over the nodule, lifted, back through the air: work that was given out, percent of
/// what was put in at most; below 0: lost.
double work_given_out_percent(const std::shared_ptr<const Model>& model, double speed_mm_s);
/// How much more the tick makes over the nodule than at the same place of a block without one, percent: of
/// force at that depth, and of stiffness over the last millimetre of it.
struct OverNodule {
  double force_percent, stiffness_percent;
};
/// @param nodule,plain  yielding_block with and without one, of the same law
OverNodule over_nodule(const std::shared_ptr<const Model>& nodule, const std::shared_ptr<const Model>& plain,
                       double depth_mm);

}  // namespace palpate
