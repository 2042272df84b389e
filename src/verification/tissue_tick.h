#pragma once

#include <memory>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/haptics/haptics.h"

/// What a tick makes of soft tissue that is solved beside it (YieldSolver), along ways that a tool is led.
namespace palpate {

/// A block of 10 kPa on a plate 24 mm below its surface, z = 0, voxels of 1 mm; with a nodule 8 mm wide and
/// 10 times as stiff, 5 mm deep at x = y = 0, or without. Ready for the proxy; a tool of 3 mm radius.
/// @param relaxation  of block and nodule
Result<std::shared_ptr<const Model>> yielding_block(bool nodule, TissueLaw law = TissueLaw::kElastic,
                                                    const Relaxation& relaxation = {});

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

/// Beside the same tool in a block that does not relax, whose forces are weighed by what the series has left
/// of them since (Boltzmann's superposition), percent of the force.
struct RelaxedOff {
  double pressed_percent = 0;  ///< at most, while it is pressed 3 mm in at 100 mm/s and in the second after
  double held_percent = 0;     ///< at most, while it is held so from then on
  double left = 0;             ///< of the force at once, in the end
  int samples = 0;
};
RelaxedOff press_relaxing(const std::shared_ptr<const Model>& relaxing,
                          const std::shared_ptr<const Model>& elastic, const Relaxation& relaxation,
                          double held_s);
/// Swung 3 mm deep by sines of several frequencies at once: how far the angle by which the force is ahead of
/// the same block's that does not relax is off that of the series, and its size, percent.
struct SwungOff {
  double hz = 0;
  double angle_percent = 0, size_percent = 0;
  double angle_deg = 0;
};
std::vector<SwungOff> swing_relaxing(const std::shared_ptr<const Model>& relaxing,
                                     const std::shared_ptr<const Model>& elastic,
                                     const Relaxation& relaxation);

}  // namespace palpate
