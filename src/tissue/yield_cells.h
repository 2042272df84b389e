#pragma once

#include <array>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/haptics/yield.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/yield_solver.h"

/// The cells around a tool on which soft tissue is solved.
namespace palpate {

/// No patch has a radius of more than this part of the box.
inline constexpr double kMostPatchPart = 0.25;

/// Where the middle of a box belongs for a tool that presses at a place of the surface: so deep below it that
/// most of the box is tissue. In cells of the lattice over the whole volume, on which every box lies wherever
/// it goes.
/// @param outward  unit, of the surface there
Eigen::Vector3d middle_below(const Model& model, const Point<Patient>& at, const Vector<Patient>& outward);
/// The first cell of a box with that middle, and whether a box still reaches around one.
std::array<int, 3> first_cell_around(const Model& model, const Eigen::Vector3d& middle);
bool is_around(const Model& model, const std::array<int, 3>& first_cell, const Eigen::Vector3d& middle);
/// YieldSolver::displacing_N of tissue that relaxes.
/// @param tissue  where the tool leans
double displacing_at_once_N(const DeviceTick& felt, const YieldingTissue& tissue, double radius_mm);
/// The cells of a box, with tissue beyond its faces as a load at YieldBox::about finds it.
CarvedCells yield_cells(const Model& model, const std::vector<ElasticMaterial>& by_label,
                        const YieldBox& box);

}  // namespace palpate
