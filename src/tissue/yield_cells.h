#pragma once

#include <array>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/yield_solver.h"

/// The cells around a tool on which soft tissue is solved.
namespace palpate {

/// A place in cells of the lattice over the whole volume, on which every box lies wherever it goes.
Eigen::Vector3d in_yield_cells(const Model& model, const Point<Patient>& at);
/// The first cell of a box with a place in its middle, and whether a box still reaches around one.
std::array<int, 3> first_cell_around(const Eigen::Vector3d& in_cells);
bool is_around(const std::array<int, 3>& first_cell, const Eigen::Vector3d& in_cells);
/// The cells of a box, with tissue beyond its faces as a load at YieldBox::about finds it.
CarvedCells yield_cells(const Model& model, const std::vector<ElasticMaterial>& by_label,
                        const YieldBox& box);

}  // namespace palpate
