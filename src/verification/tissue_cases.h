#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "palpate/tissue/elastic_grid.h"

/// Soft tissue against what is known of elastic bodies; docs/results/tissue.md has a table of the cases.
namespace palpate {

/// What comes out beside what should.
struct TissueCase {
  double off_percent = 0;
  int iterations = 0;  ///< of the solver, at most
};

/// A block whose surface is displaced by u = A x: the farthest
/// node inside from A x, percent of the greatest displacement.
TissueCase patch_case(int cells, double poissons_ratio);
/// Forces of a block that is turned by a small angle, percent of those of a shear as large.
TissueCase turned_case(int cells);
/// A beam six times as long as it is high, held at one end: how far its tip sinks (Timoshenko, shear
/// coefficient of Cowper 1966).
TissueCase cantilever_case(int cells_high);
/// Cook's membrane in plane stress, E 1, nu 1/3, F 1: the middle of its tip rises by 23.96. Its oblique edges
/// run through cells.
TissueCase cook_case(int cells_long);
/// Layers of 5 and 50 kPa that cannot spread, pressed between plates; their seam lies so far into a cell.
TissueCase series_case(double seam_in_cell);
/// A load on a half space: the surface's depth 4 to 10 cells off, in the mean (Boussinesq 1885).
TissueCase boussinesq_case(int cells, double poissons_ratio);

/// Where a sphere presses on a half space: any normal, any place of the grid under it.
struct HalfSpacePress {
  int cells = 32;  ///< along each axis of the box, in whose middle it presses
  double poissons_ratio = 0.45;
  Vector<Patient> outward = {0, 0, 1};
  Vector<Patient> offset_cells;  ///< of the surface from the box's middle
  double radius_cells = 1;       ///< of the contact
};
/// Hertz: F = 4/3 E / (1 - nu2) sqrt(R) d^1.5.
TissueCase hertz_case(const HalfSpacePress& press);
/// The same while it slides over a cell and more in steps: largest less smallest force, percent of the mean.
TissueCase ripple_case(const HalfSpacePress& press, int steps);

/// A flat punch of so many cells' radius on a half space: F = 2 a E d / (1 - nu2).
TissueCase punch_case(int cells, int radius_cells);
/// A sphere on a layer that is bonded to bone (Dimitriadis et al. 2002, any nu). @param part  sqrt(R d) / t:
/// at 0.4 the contact's radius is half of the thickness
TissueCase layer_case(int cells_thick, double poissons_ratio, double part);

/// A neo-Hookean block that may spread, pressed or pulled to so much of its height: its force beside the root
/// of its two equations.
TissueCase stretched_case(double part);
/// A sphere pressed into a layer on bone, by so much of its thickness, at the nodes that it touches in the
/// linear body: how far the linear force is from the neo-Hookean one. `frame_ms`: processor time of a Newton
/// step with up to 3 iterations, which goes on by a third of a cell, the median; `frame_off_percent`: of that
/// force at most, from the second step on.
struct FiniteLayer {
  double linear_off_percent = 0, frame_ms = 0, frame_off_percent = 0, min_volume = 1;
  std::size_t cells = 0;
  bool converged = true;
};
FiniteLayer finite_layer(std::array<int, 3> cells, double part);

/// How fast the error falls: the field of a force outside the block (Kelvin), given on the block's surface,
/// inside it; the order from blocks of `cells` and twice as many along an axis.
double convergence_order(int cells);

/// A nodule 8 cells wide and 10 times as stiff, 5 deep: pressed, slid over and lifted on a closed way, work
/// that is not given back, percent of what was put in; with the force along the surface, and without it.
struct NoduleLoop {
  double off_percent = 0, off_without_percent = 0;
  double stiffer_percent = 0;  ///< force over the nodule beyond that beside it
};
NoduleLoop nodule_loop(int cells, int steps);

}  // namespace palpate
