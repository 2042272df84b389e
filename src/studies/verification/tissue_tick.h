#pragma once

#include <memory>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/contact/model.h"

/// Force of the tick on soft tissue that is solved asynchronously (SoftTissueSolver), along prescribed tool
/// paths.
namespace palpate {

/// Block of 10 kPa on a plate 24 mm below its surface z = 0, with voxels of 1 mm; optionally with a nodule 8
/// mm wide and 10 times as stiff, 5 mm deep at x = y = 0. Ready for the proxy, with a tool of 3 mm radius.
/// @param relaxation  of block and nodule
Result<std::shared_ptr<const Model>> soft_block(bool nodule, TissueLaw law = TissueLaw::kElastic,
                                                const Relaxation& relaxation = {});

/// Error of the tick's force relative to that of the converged solution at the same position.
struct TickError {
  double largest_percent = 0, mean_percent = 0;  ///< Percent of the path's peak force
  double peak_N = 0;
  int samples = 0;
};
/// Presses at a constant speed to 4 mm, at `x_mm`.
TickError press_tissue(const std::shared_ptr<const Model>& model, double speed_mm_s, double x_mm);
/// Slides at a constant speed 3 mm deep, from x = -18 mm to 18 mm.
TickError slide_on_tissue(const std::shared_ptr<const Model>& model, double speed_mm_s);
/// Maximum change of the force per tick while held still 4 mm deep, from 0.1 s after the motion, N.
double change_at_rest_N(const std::shared_ptr<const Model>& model);
/// Presses 3 mm deep, slides over the nodule, lifts and returns through free space: energy generated, percent
/// of the maximum energy put in; negative: dissipated.
double generated_work_percent(const std::shared_ptr<const Model>& model, double speed_mm_s);
/// Increase over the nodule relative to the same position of a block without one, percent: of the force at
/// that depth, and of the secant stiffness over its last millimetre.
struct OverNodule {
  double force_percent, stiffness_percent;
};
/// @param nodule,plain  soft_block with and without a nodule, with the same law
OverNodule over_nodule(const std::shared_ptr<const Model>& nodule, const std::shared_ptr<const Model>& plain,
                       double depth_mm);

/// Error of the force of a relaxing block, percent. The reference is the same tool in a block without
/// relaxation, with its force history weighted by the relaxation function (Boltzmann superposition).
struct RelaxationError {
  /// Maximum while it is pressed 3 mm deep at 100 mm/s and in the following second
  double pressed_percent = 0;
  double hold_percent = 0;        ///< Maximum while it is held afterwards
  double remaining_fraction = 0;  ///< Final fraction of the instantaneous force
  int samples = 0;
};
RelaxationError press_relaxing(const std::shared_ptr<const Model>& relaxing,
                               const std::shared_ptr<const Model>& elastic, const Relaxation& relaxation,
                               double held_s);
/// Oscillation around a depth of 3 mm by a sum of sines: errors of phase lead and magnitude, relative to the
/// block without relaxation, compared with those of the Prony series; percent.
struct OscillationError {
  double hz = 0;
  double phase_error_percent = 0, magnitude_error_percent = 0;
  double angle_deg = 0;
};
std::vector<OscillationError> swing_relaxing(const std::shared_ptr<const Model>& relaxing,
                                             const std::shared_ptr<const Model>& elastic,
                                             const Relaxation& relaxation);

}  // namespace palpate
