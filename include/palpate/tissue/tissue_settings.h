#pragma once

#include "palpate/contact/contact_settings.h"

namespace palpate {

/// Constants of material removal that are not part of the scene. They are fixed for one version of palpate
/// and written to every recording (docs/reference/feel.md). docs/decisions/0029 justifies the values. mm in
/// the patient.
struct CuttingSettings {
  /// Distance ahead of the burr's surface at which material is sampled. A sample counts as material from half
  /// of that depth on; at the rim of a cavity, where the burr's surface leaves the material, samples are
  /// shallower.
  double lookahead_mm = 0.1;
  /// Limits of the feed: depth per tick, and, while the surfaces have not been rebuilt, total inset as a
  /// fraction of the burr's least radius.
  double max_feed_mm = 0.1, max_inset_fraction = 0.8;
  /// Merging of consecutive paths into one sweep: largest deviation from a straight line, largest length, and
  /// largest displacement of the far end by rotation. A sweep is computed with the head's orientation at its
  /// end; the material that consecutive sweeps both miss is therefore much thinner than max_turn_mm.
  double max_deviation_mm = 0.002, max_sweep_mm = 0.25, max_turn_mm = 0.05;
  /// A sweep is completed after this time at the latest.
  double max_sweep_s = 0.01;
  /// A substep of the proxy that moves the head away from the tip by more than this fraction of its length is
  /// rejected: a steeper climb would remove more material than the motor's work allows.
  double max_distance_increase = 0.02;
  /// Displacements below this count as no motion.
  double at_rest_mm = 1e-6;
  /// Penetration of a protected structure up to which a head counts as touching it, and displacement per tick
  /// by which a larger penetration is resolved.
  double contact_tolerance_mm = 1e-4, recovery_mm = 1e-3;
  /// Interpolation error of a surface between voxels: after a cut its distance may be underestimated by up to
  /// this.
  double surface_error_mm = 1e-4;
  /// Displacement of a surface from which on the normal is entirely recomputed, because the prepared normal
  /// describes removed material.
  double stale_normal_mm = 0.25;
  /// Minimum bone thickness (diameter of an inscribed ball) at which the material ahead is measured from the
  /// surface; thinner bone is measured from its voxels, sampled thin_lookahead_mm ahead of the burr's
  /// surface.
  double thick_mm = 2.4, thin_lookahead_mm = 0.02;
  /// Energy account of a burr: volume that may be removed in excess of the motor's work before it is charged,
  /// and maximum volume credited for excess work; first for thick bone, where both are within the sampling
  /// error, then for thin bone.
  double thick_uncharged_mm3 = 1, thick_credited_mm3 = 0.3, thin_uncharged_mm3 = 0.05,
         thin_credited_mm3 = 0.2;
  /// Range of the density of bone relative to full density, for its cutting energy (density_ratio).
  double min_density = 0.1, max_density = 1.25;
  /// Pose age from which on a motor is stopped.
  double motor_timeout_s = 10e-3;
  /// Number of sampling directions, spread evenly over a ball's projection.
  int directions = 64;
  /// Number of sampling directions in thin bone, where they are rotated in every tick.
  int thin_directions = 128;
  /// Number of sampling points around the lateral surface of a cylinder or cone; half of them face forwards.
  int lateral_samples = 128;
  /// Maximum number of iterations per tick that place the head outside protected structures.
  int max_iterations = 4;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("lookahead_mm", lookahead_mm);
    visitor("max_feed_mm", max_feed_mm);
    visitor("max_inset_fraction", max_inset_fraction);
    visitor("max_deviation_mm", max_deviation_mm);
    visitor("max_sweep_mm", max_sweep_mm);
    visitor("max_turn_mm", max_turn_mm);
    visitor("max_sweep_s", max_sweep_s);
    visitor("max_distance_increase", max_distance_increase);
    visitor("at_rest_mm", at_rest_mm);
    visitor("contact_tolerance_mm", contact_tolerance_mm);
    visitor("recovery_mm", recovery_mm);
    visitor("surface_error_mm", surface_error_mm);
    visitor("stale_normal_mm", stale_normal_mm);
    visitor("thick_mm", thick_mm);
    visitor("thin_lookahead_mm", thin_lookahead_mm);
    visitor("thick_uncharged_mm3", thick_uncharged_mm3);
    visitor("thick_credited_mm3", thick_credited_mm3);
    visitor("thin_uncharged_mm3", thin_uncharged_mm3);
    visitor("thin_credited_mm3", thin_credited_mm3);
    visitor("min_density", min_density);
    visitor("max_density", max_density);
    visitor("motor_timeout_s", motor_timeout_s);
    visitor("directions", directions);
    visitor("thin_directions", thin_directions);
    visitor("lateral_samples", lateral_samples);
    visitor("max_iterations", max_iterations);
  }
};

/// Constants of the soft tissue solver that runs concurrently with the tick (soft_tissue_solver.h).
struct SolverSettings {
  /// Prediction horizon: a solution is computed for the tool's position this many frames after the tick that
  /// it starts from (one frame until it is published, and half of the frame in which it is used), limited to
  /// max_lead_mm of displacement.
  double lead_frames = 1.5, max_lead_mm = 5;
  /// Distance from the nearest surface beyond which no contact is predicted.
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
  /// suffice to follow this change.
  double max_fill_change = 0.2;
  /// Size of the box: along the contiguous axis in memory, and across it. It is the budget of a frame: on the
  /// processor of docs/results/tissue.md a frame of that many cells takes half of its 1/64 s.
  int cells_along = 47, cells_across = 32;
  /// Default cell size: the smallest between one voxel and max_cell_voxels voxels at which the box is
  /// box_radii radii of the widest tool across; clamped to min_cell_mm ... max_cell_mm.
  double box_radii = 3, max_cell_voxels = 2, min_cell_mm = 0.8, max_cell_mm = 3;
  /// Size of the box for the neo-Hookean law, smaller because a frame costs three times as much per cell.
  int finite_cells_along = 31, finite_cells_across = 26;
  /// Newton steps per frame, linear iterations per step, and iterations of the tangential solve.
  int finite_steps = 1, finite_iterations = 4, tangential_iterations = 2;
  /// Columns of nodes that bear at least this fraction of the most loaded column's share are constrained to
  /// the tool's surface.
  double min_load_fraction = 0.01;
  /// Range of the patch's displacement as a fraction of its radius: for a shallower or deeper tool, or
  /// without contact, the law is solved at the bound and extrapolated.
  double min_indentation = 0.1, max_indentation = 1.2;
  /// Minimum det F (remaining volume fraction) of any cell; a neo-Hookean solution below it is discarded.
  double min_volume = 0.15;

  template <class Visit>
  constexpr void visit(Visit&& visitor) const {
    visitor("lead_frames", lead_frames);
    visitor("max_lead_mm", max_lead_mm);
    visitor("reach_mm", reach_mm);
    visitor("step_cells", step_cells);
    visitor("max_offset_cells", max_offset_cells);
    visitor("depth_cells", depth_cells);
    visitor("iterations", iterations);
    visitor("first_iterations", first_iterations);
    visitor("min_patch_cells", min_patch_cells);
    visitor("thin_layer_cells", thin_layer_cells);
    visitor("resolved_layer_cells", resolved_layer_cells);
    visitor("max_base_depth_mm", max_base_depth_mm);
    visitor("max_fill_change", max_fill_change);
    visitor("cells_along", cells_along);
    visitor("cells_across", cells_across);
    visitor("box_radii", box_radii);
    visitor("max_cell_voxels", max_cell_voxels);
    visitor("min_cell_mm", min_cell_mm);
    visitor("max_cell_mm", max_cell_mm);
    visitor("finite_cells_along", finite_cells_along);
    visitor("finite_cells_across", finite_cells_across);
    visitor("finite_steps", finite_steps);
    visitor("finite_iterations", finite_iterations);
    visitor("tangential_iterations", tangential_iterations);
    visitor("min_load_fraction", min_load_fraction);
    visitor("min_indentation", min_indentation);
    visitor("max_indentation", max_indentation);
    visitor("min_volume", min_volume);
  }
};
inline constexpr CuttingSettings kCuttingSettings;
inline constexpr SolverSettings kSolverSettings;
static_assert(names_every_member<CuttingSettings>() && names_every_member<SolverSettings>());

}  // namespace palpate
