#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "palpate/tissue/elastic_grid.h"

/// Soft tissue compared with analytic solutions of elasticity; docs/results/tissue.md has a table of the
/// cases.
namespace palpate {

/// Deviation from the analytic solution.
struct TissueDeviation {
  double error_percent = 0;  ///< Relative to the analytic solution
  int iterations = 0;        ///< Maximum of the solver
};

/// Patch test: a block with surface displacement u = A x. Maximum deviation of the interior nodes from A x,
/// percent of the largest displacement.
TissueDeviation patch_case(int cells, double poissons_ratio);
/// Forces of a block under a small rotation, percent of those under an equal shear.
TissueDeviation turned_case(int cells);
/// Cantilever beam with a length of six times its height: deflection of its tip (Timoshenko, shear
/// coefficient of Cowper 1966).
TissueDeviation cantilever_case(int cells_high);
/// Cook's membrane in plane stress, E 1, nu 1/3, F 1: the middle of its tip rises by 23.96. Its oblique edges
/// cut through cells.
TissueDeviation cook_case(int cells_long);
/// Laterally constrained layers of 5 and 50 kPa, compressed between plates; `seam_in_cell` is the position of
/// their interface within a cell.
TissueDeviation series_case(double seam_in_cell);
/// Point load on a half-space: mean surface displacement at a distance of 4 to 10 cells (Boussinesq 1885).
TissueDeviation boussinesq_case(int cells, double poissons_ratio);

/// A sphere pressed into a half-space, with any normal and any position relative to the grid.
struct HalfSpacePress {
  int cells = 32;  ///< Along each axis of the box; the contact is at its centre
  double poissons_ratio = 0.45;
  Vector<Patient> outward = {0, 0, 1};
  Vector<Patient> offset_cells;  ///< Offset of the surface from the box's centre
  double radius_cells = 1;       ///< Contact radius
};
/// Hertz contact: F = 4/3 E / (1 - nu2) sqrt(R) d^1.5.
TissueDeviation hertz_case(const HalfSpacePress& press);
/// Same while sliding over more than a cell in steps: range of the force, percent of its mean.
TissueDeviation ripple_case(const HalfSpacePress& press, int steps);

/// Flat punch with a radius in cells on a half-space: F = 2 a E d / (1 - nu2).
TissueDeviation punch_case(int cells, int radius_cells);
/// Sphere on a layer bonded to bone (Dimitriadis et al. 2002, any nu).
/// @param depth_ratio  sqrt(R d) / t; at 0.4 the contact radius is half of the thickness
TissueDeviation layer_case(int cells_thick, double poissons_ratio, double depth_ratio);

/// Uniaxial compression or extension of a laterally free neo-Hookean block to a fraction of its height: its
/// force compared with the solution of the two equations.
TissueDeviation stretched_case(double height_ratio);
/// Sphere pressed into a layer on bone, by a fraction of its thickness, at the nodes in contact according to
/// the linear solution: deviation of the linear force from the neo-Hookean one. `frame_ms`: median processor
/// time of a Newton step with up to 3 iterations, in which the depth increases by a third of a cell;
/// `frame_error_percent`: maximum error of its force from the second step on.
struct FiniteLayer {
  double linear_error_percent = 0, frame_ms = 0, frame_error_percent = 0, min_volume = 1;
  std::size_t cells = 0;
  bool converged = true;
};
FiniteLayer finite_layer(std::array<int, 3> cells, double depth_ratio);

/// Convergence order: interior error for the field of a point force outside the block (Kelvin), prescribed on
/// the block's surface, from blocks with `cells` and twice as many cells along an axis.
double convergence_order(int cells);

/// Nodule 8 cells wide, 10 times as stiff and 5 cells deep: pressing, sliding over it and lifting on a closed
/// path. Energy error, percent of the energy put in, with the tangential force and without it.
struct NoduleLoop {
  double error_percent = 0, error_without_tangential_percent = 0;
  double stiffer_percent = 0;  ///< Excess of the force over the nodule relative to the force beside it
};
NoduleLoop nodule_loop(int cells, int steps);

}  // namespace palpate
