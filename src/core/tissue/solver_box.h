#pragma once

#include <array>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/contact/soft_contact.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/soft_tissue_solver.h"

/// Placement of the boxes of cells around tools on which soft tissue is solved.
namespace palpate {

/// Upper limit of a patch's radius, as a fraction of the box's width.
inline constexpr double kMaxPatchRadiusFraction = 0.25;

/// Middle of the box for a tool that presses on a surface point: far enough below the surface that most of
/// the box is tissue. In cells of the lattice over the whole volume, with which every box is aligned.
/// @param outward  unit normal of the surface there
Eigen::Vector3d solver_box_centre(const Model& model, const Point<Patient>& at,
                                  const Vector<Patient>& outward);
/// First cell of the box with that middle, and whether an existing box still covers a middle.
std::array<int, 3> first_cell_around(const Model& model, const Eigen::Vector3d& centre);
bool box_covers(const Model& model, const std::array<int, 3>& first_cell, const Eigen::Vector3d& centre);
/// SoftTissueSolver::displacing_force_N for tissue that relaxes or stiffens with strain.
/// @param tissue        tissue at the contact
/// @param max_N_per_mm  max_deformable_stiffness_N_per_mm() of the model
double instantaneous_force_N(const DeviceTick& device, const ContactLaw& tissue, double radius_mm,
                             double max_N_per_mm);
/// Cells of a box, with springs on its faces for a load at SolverBox::about.
CarvedCells solver_box_cells(const Model& model, const std::vector<ElasticMaterial>& by_label,
                             const SolverBox& box);

}  // namespace palpate
