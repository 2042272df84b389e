#include "tissue/solver_box.h"

#include <cmath>
#include <utility>

#include "palpate/device/rendered_stiffness.h"

namespace palpate {
namespace {

std::array<int, 3> cells_of_box(const Model& model) {
  const auto& [along, across] =
      is_hyperelastic(model.tissue_law)
          ? std::pair(kSolverSettings.finite_cells_along, kSolverSettings.finite_cells_across)
          : std::pair(kSolverSettings.cells_along, kSolverSettings.cells_across);
  const auto fewer = [&](int cells) {
    return static_cast<int>(std::floor(cells / model.tissue_cell_factor + 0.5));
  };
  return {fewer(along), fewer(across), fewer(across)};
}

ElasticBox lattice_of(const Model& model) {
  return elastic_box_of(model.labels->geometry(), {{0, 0, 0}, {1, 1, 1}}, solver_cell_mm(model));
}

}  // namespace

Eigen::Vector3d solver_box_centre(const Model& model, const Point<Patient>& at,
                                  const Vector<Patient>& outward) {
  const ElasticBox lattice = lattice_of(model);
  const double depth_cells = kSolverSettings.depth_cells / model.tissue_cell_factor;
  return lattice.local_mm(at - outward * (depth_cells * lattice.cell_mm)) / lattice.cell_mm;
}

std::array<int, 3> first_cell_around(const Model& model, const Eigen::Vector3d& centre) {
  const std::array<int, 3> cells = cells_of_box(model);
  std::array<int, 3> first;
  for (int axis = 0; axis < 3; ++axis) {
    const double step = kSolverSettings.step_cells;
    first[axis] = kSolverSettings.step_cells *
                  static_cast<int>(std::floor((centre[axis] - 0.5 * cells[axis]) / step + 0.5));
  }
  return first;
}

bool box_covers(const Model& model, const std::array<int, 3>& first_cell, const Eigen::Vector3d& centre) {
  const std::array<int, 3> cells = cells_of_box(model);
  for (int axis = 0; axis < 3; ++axis)
    if (std::abs(centre[axis] - first_cell[axis] - 0.5 * cells[axis]) >
        kSolverSettings.max_offset_cells / model.tissue_cell_factor)
      return false;
  return true;
}

double instantaneous_force_N(const DeviceTick& device, const ContactLaw& tissue, double radius_mm,
                             double max_N_per_mm) {
  if (!(tissue.modulus_N_per_mm2 > 0)) return device.contact_N[0];
  ContactLaw base = tissue;
  base.strain_stiffening = 0;
  // fmin, because the device's limit is NaN if unknown
  return soft_contact_force(base, device.depth_mm, radius_mm,
                            std::fmin(RenderedStiffness(device).max_in_patient(), max_N_per_mm))
      .force_N;
}

CarvedCells solver_box_cells(const Model& model, const std::vector<ElasticMaterial>& by_label,
                             const SolverBox& where) {
  ElasticBox box = lattice_of(model);
  box.cells = cells_of_box(model);
  const auto& first = where.first_cell;
  box.corner = box.patient(Eigen::Vector3d(first[0], first[1], first[2]) * box.cell_mm);
  return {carved_labels(model), by_label, box, where.about};
}

}  // namespace palpate
