#pragma once

#include "palpate/haptics/feel.h"

namespace palpate {

/// What decides how a burr cuts and feels besides the scene, the same in every run of one version of palpate:
/// recordings tell it (docs/reference/feel.md). docs/decisions/0029 has the choices; mm in the patient.
struct CuttingFeel {
  /// It looks for material so far before its surface. Half of that deep, an edge begins to count, so that
  /// beside a pocket, where its surface comes out of the material, little counts that it does not touch.
  double ahead_mm = 0.1;
  /// It sinks in by no more in a tick, and while the surfaces are not made by no more than a part of its
  /// least radius.
  double most_feed_mm = 0.1, most_inset_part = 0.8;
  /// Ways that bend by less, and are no longer, are one sweep, if the far end is turned aside by no more than
  /// turned_mm: what the head is turned by is taken as its end has it. The end before it was so turned as the
  /// next one begins, so that what is between them and in neither is thinner by far.
  double straight_mm = 0.002, longest_mm = 0.25, turned_mm = 0.05;
  /// A sweep is finished after so long at the latest.
  double longest_sweep_s = 0.01;
  /// A stride of a head that leads away from the tip by more than this part of itself is not taken: one that
  /// climbs more takes more than its motor works for.
  double away = 0.02;
  /// Less of a way is none.
  double still_mm = 1e-6;
  /// A head touches what is kept from so near on, and comes out of it, where it lies in it a little, so fast
  /// in a tick.
  double touching_mm = 1e-4, regained_mm = 1e-3;
  /// A surface is read from between its voxels: it may be so much nearer than it was cut.
  double rounding_mm = 1e-4;
  /// Where a surface moved by this much its normal is all its own: the prepared one is of what is gone.
  double moved_mm = 0.25;
  /// A motor stands still while the pose is so old or older.
  double motor_stops_s = 10e-3;
  /// Directions ahead, spread evenly over the disc that a ball is from ahead.
  int directions = 64;
  /// Places on the side of a cylinder or cone, all around; half of them are ahead.
  int side_places = 128;
  /// Tries of a tick to put the head beside what is kept, at most.
  int most_tries = 4;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("ahead_mm", ahead_mm);
    of("most_feed_mm", most_feed_mm);
    of("most_inset_part", most_inset_part);
    of("straight_mm", straight_mm);
    of("longest_mm", longest_mm);
    of("turned_mm", turned_mm);
    of("longest_sweep_s", longest_sweep_s);
    of("away", away);
    of("still_mm", still_mm);
    of("touching_mm", touching_mm);
    of("regained_mm", regained_mm);
    of("rounding_mm", rounding_mm);
    of("moved_mm", moved_mm);
    of("motor_stops_s", motor_stops_s);
    of("directions", directions);
    of("side_places", side_places);
    of("most_tries", most_tries);
  }
};

/// What decides how soft tissue beside the tick is solved (yield_solver.h).
struct SolvingFeel {
  /// A solution is for where the tool will be so many frames after the tick that it is made from: one until
  /// it is told, and the middle of the one in which it is felt. At most so far away.
  double lead_frames = 1.5, most_lead_mm = 5;
  /// A tool that is farther from every surface presses nothing soon.
  double reach_mm = 15;
  /// The box is laid anew, in steps of so many cells, when the tool is so far from its middle: springs stand
  /// for the tissue beyond its faces, and the nearer they are the less they know.
  int step_cells = 2, farthest_cells = 5;
  /// Its middle is so many cells below the surface: a third of the box lies above a surface in its middle,
  /// where nothing is, while what is hard below it decides how much gives way.
  double deeper_cells = 10;
  /// Iterations of a frame, and of one in a box that has just been laid.
  int iterations = 2, first_iterations = 12;
  /// The pressure's patch is no smaller than so many cells: nodes know nothing of a smaller one.
  double least_patch_cells = 3;
  /// By no more does the solid part of a cell change in a frame, whatever was taken away or put back: so much
  /// follows two iterations.
  double most_fill_change = 0.2;
  /// Of the box, along the longest row in memory and across it.
  int cells_along = 47, cells_across = 32;
  /// Of the neo-Hookean law it is smaller, because a frame takes three times the work a cell.
  int finite_cells_along = 31, finite_cells_across = 26;
  /// Newton's steps of a frame, iterations of each, and of what makes the force aside.
  int finite_steps = 1, finite_iterations = 4, aside_iterations = 2;
  /// Columns of nodes that bear so much of what the one does that bears most are held as the tool's surface
  /// is.
  double least_bearing = 0.01;
  /// The patch is pressed in by no less and no more than these parts of its radius: where the tool is less
  /// deep, or in the air, or deeper, the law of those is carried on.
  double least_give = 0.1, most_give = 1.2;
  /// With a cell that keeps less of its volume nothing is said of the neo-Hookean body.
  double least_volume = 0.15;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("lead_frames", lead_frames);
    of("most_lead_mm", most_lead_mm);
    of("reach_mm", reach_mm);
    of("step_cells", step_cells);
    of("farthest_cells", farthest_cells);
    of("deeper_cells", deeper_cells);
    of("iterations", iterations);
    of("first_iterations", first_iterations);
    of("least_patch_cells", least_patch_cells);
    of("most_fill_change", most_fill_change);
    of("cells_along", cells_along);
    of("cells_across", cells_across);
    of("finite_cells_along", finite_cells_along);
    of("finite_cells_across", finite_cells_across);
    of("finite_steps", finite_steps);
    of("finite_iterations", finite_iterations);
    of("aside_iterations", aside_iterations);
    of("least_bearing", least_bearing);
    of("least_give", least_give);
    of("most_give", most_give);
    of("least_volume", least_volume);
  }
};
inline constexpr CuttingFeel kCuttingFeel;
inline constexpr SolvingFeel kSolvingFeel;
static_assert(names_every_member<CuttingFeel>() && names_every_member<SolvingFeel>());

}  // namespace palpate
