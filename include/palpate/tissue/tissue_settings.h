#pragma once

#include "palpate/contact/contact_settings.h"

namespace palpate {

/// Constants of material removal besides the scene. They are fixed for one version of palpate and written to
/// every recording (docs/reference/feel.md). docs/decisions/0029 justifies the values. mm in the patient.
struct CuttingSettings {
  /// Distance ahead of the burr's surface at which material is sampled. A sample counts as cut from half of
  /// that depth; beside a pocket, where the burr's surface leaves the material, samples are less deep.
  double lookahead_mm = 0.1;
  /// Limits of the feed: depth per tick, and, while the surfaces have not been rebuilt, total inset as a
  /// fraction of the burr's least radius.
  double max_feed_mm = 0.1, max_inset_fraction = 0.8;
  /// Merging of consecutive paths into one sweep: largest deviation from a straight line, largest length, and
  /// largest displacement of the far end by rotation. A sweep has the head's orientation at its end. Its
  /// start had the orientation with which the next sweep begins, so material between two sweeps that belongs
  /// to neither is much thinner than max_turn_mm.
  double max_deviation_mm = 0.002, max_sweep_mm = 0.25, max_turn_mm = 0.05;
  /// A sweep is completed after this time at the latest.
  double max_sweep_s = 0.01;
  /// A substep of the proxy that moves the head away from the tip by more than this fraction of its length is
  /// rejected: a steeper climb would remove more than the motor's work pays for.
  double max_distance_increase = 0.02;
  /// Displacements below this count as no motion.
  double at_rest_mm = 1e-6;
  /// Distance at which a head is in contact with a protected structure, and the speed per tick at which it
  /// leaves a slight penetration.
  double contact_tolerance_mm = 1e-4, recovery_mm = 1e-3;
  /// Error of the surface between voxels: it may read closer by this much than it was cut.
  double surface_error_mm = 1e-4;
  /// Displacement of a surface from which on the normal is entirely recomputed, because the prepared normal
  /// describes removed material.
  double stale_normal_mm = 0.25;
  /// Diameter of a ball that must fit into bone for its surface to measure the material ahead; thinner bone
  /// is measured by its voxels, which are sampled at a distance ahead of the burr's surface.
  double thick_mm = 2.4, thin_lookahead_mm = 0.02;
  /// Energy account of a burr: volume beyond what the motor has paid for up to which nothing is charged, and
  /// largest volume that is credited when it was paid for in excess; in thick bone within the error of its
  /// sampling, and in thin bone.
  double thick_uncharged_mm3 = 1, thick_credited_mm3 = 0.3, thin_uncharged_mm3 = 0.05,
         thin_credited_mm3 = 0.2;
  /// Range of the density of bone relative to full density, for its cutting energy (density_ratio).
  double min_density = 0.1, max_density = 1.25;
  /// Pose age from which on a motor stands still.
  double motor_timeout_s = 10e-3;
  /// Number of sampling directions, spread evenly over a ball's projection.
  int directions = 64;
  /// The same in thin bone, where they turn from tick to tick.
  int thin_directions = 128;
  /// Number of sampling points around the lateral surface of a cylinder or cone; half of them face forwards.
  int lateral_samples = 128;
  /// Maximum number of iterations per tick that place the head outside protected structures.
  int max_iterations = 4;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("lookahead_mm", lookahead_mm);
    of("max_feed_mm", max_feed_mm);
    of("max_inset_fraction", max_inset_fraction);
    of("max_deviation_mm", max_deviation_mm);
    of("max_sweep_mm", max_sweep_mm);
    of("max_turn_mm", max_turn_mm);
    of("max_sweep_s", max_sweep_s);
    of("max_distance_increase", max_distance_increase);
    of("at_rest_mm", at_rest_mm);
    of("contact_tolerance_mm", contact_tolerance_mm);
    of("recovery_mm", recovery_mm);
    of("surface_error_mm", surface_error_mm);
    of("stale_normal_mm", stale_normal_mm);
    of("thick_mm", thick_mm);
    of("thin_lookahead_mm", thin_lookahead_mm);
    of("thick_uncharged_mm3", thick_uncharged_mm3);
    of("thick_credited_mm3", thick_credited_mm3);
    of("thin_uncharged_mm3", thin_uncharged_mm3);
    of("thin_credited_mm3", thin_credited_mm3);
    of("min_density", min_density);
    of("max_density", max_density);
    of("motor_timeout_s", motor_timeout_s);
    of("directions", directions);
    of("thin_directions", thin_directions);
    of("lateral_samples", lateral_samples);
    of("max_iterations", max_iterations);
  }
};

/// Constants of the soft tissue solver that runs concurrently with the tick (soft_tissue_solver.h).
struct SolverSettings {
  /// Prediction horizon: a solution is computed for the tool's position this many frames after the tick that
  /// it starts from (one frame until it is published, and half of the frame in which it is used), limited to
  /// max_lead_mm of displacement.
  double lead_frames = 1.5, max_lead_mm = 5;
  /// Distance from every surface beyond which a tool is not expected to press soon.
  double reach_mm = 15;
  /// The box moves, in steps of step_cells, when the tool is farther than max_offset_cells from its middle:
  /// the springs at its faces only approximate the tissue beyond, and less accurately the closer the load.
  int step_cells = 2, max_offset_cells = 5;
  /// Depth of the box's middle below the surface. A box centred on the surface would have a third of its
  /// height above it, where there is no tissue, while rigid structures below determine much of the
  /// compliance.
  double depth_cells = 10;
  /// Iterations per frame, and in the first frame of a new box.
  int iterations = 2, first_iterations = 12;
  /// Minimum radius of the pressure patch in cells: the nodes cannot resolve a smaller one.
  double min_patch_cells = 3;
  /// Thickness in cells up to which the cells resolve a layer of one tissue on a rigid base too coarsely, and
  /// from which on they resolve it. Up to the first, the base's compliance is that of the thickness measured
  /// through the voxels; from the second on, that of the solution; between them, a blend of both.
  double thin_layer_cells = 4, resolved_layer_cells = 8;
  /// Depth to which a rigid structure below the box is looked up in the voxels.
  double max_base_depth_mm = 80;
  /// Largest change of a cell's solid fraction per frame when material is removed or restored; two iterations
  /// can follow that much.
  double max_fill_change = 0.2;
  /// Size of the box: along the contiguous axis in memory, and across it. It is the budget of a frame: on the
  /// processor of docs/results/tissue.md a frame of that many cells takes half of its 1/64 s.
  int cells_along = 47, cells_across = 32;
  /// Default size of the cells: that of the voxels, or as much larger, up to max_cell_voxels, as the box
  /// needs to reach box_radii radii of the widest tool across; within min_cell_mm ... max_cell_mm.
  double box_radii = 3, max_cell_voxels = 2, min_cell_mm = 0.8, max_cell_mm = 3;
  /// Size of the box for the neo-Hookean law, smaller because a frame costs three times as much per cell.
  int finite_cells_along = 31, finite_cells_across = 26;
  /// Newton steps per frame, linear iterations per step, and iterations of the tangential solve.
  int finite_steps = 1, finite_iterations = 4, tangential_iterations = 2;
  /// Columns of nodes that bear at least this fraction of the most loaded column's share are constrained to
  /// the tool's surface.
  double min_load_fraction = 0.01;
  /// Range of the patch's displacement as a fraction of its radius: for a shallower or deeper tool, or one in
  /// the air, the law at the bound is extrapolated.
  double min_indentation = 0.1, max_indentation = 1.2;
  /// Least fraction of its volume that any cell may keep in a neo-Hookean solution; below it the solution is
  /// discarded.
  double min_volume = 0.15;

  template <class Visit>
  constexpr void visit(Visit&& of) const {
    of("lead_frames", lead_frames);
    of("max_lead_mm", max_lead_mm);
    of("reach_mm", reach_mm);
    of("step_cells", step_cells);
    of("max_offset_cells", max_offset_cells);
    of("depth_cells", depth_cells);
    of("iterations", iterations);
    of("first_iterations", first_iterations);
    of("min_patch_cells", min_patch_cells);
    of("thin_layer_cells", thin_layer_cells);
    of("resolved_layer_cells", resolved_layer_cells);
    of("max_base_depth_mm", max_base_depth_mm);
    of("max_fill_change", max_fill_change);
    of("cells_along", cells_along);
    of("cells_across", cells_across);
    of("box_radii", box_radii);
    of("max_cell_voxels", max_cell_voxels);
    of("min_cell_mm", min_cell_mm);
    of("max_cell_mm", max_cell_mm);
    of("finite_cells_along", finite_cells_along);
    of("finite_cells_across", finite_cells_across);
    of("finite_steps", finite_steps);
    of("finite_iterations", finite_iterations);
    of("tangential_iterations", tangential_iterations);
    of("min_load_fraction", min_load_fraction);
    of("min_indentation", min_indentation);
    of("max_indentation", max_indentation);
    of("min_volume", min_volume);
  }
};
inline constexpr CuttingSettings kCuttingSettings;
inline constexpr SolverSettings kSolverSettings;
static_assert(names_every_member<CuttingSettings>() && names_every_member<SolverSettings>());

}  // namespace palpate
