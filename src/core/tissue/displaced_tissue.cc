#include "palpate/tissue/displaced_tissue.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "palpate/base/cube_root.h"
#include "palpate/contact/tool_contact.h"
#include "palpate/tissue/chain_mail.h"
#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/elastic_solver.h"
#include "tissue/relaxation_weights.h"
#include "tissue/solver_box.h"
#include "tissue/trilinear_weights.h"

namespace palpate {
namespace {

// a stiff nodule converges slowest (docs/decisions/archive/0034)
constexpr int kMaxIterations = 60;
constexpr double kConverged = 1e-4;

/// Displacements of all nodes, along the box's axes.
std::vector<Eigen::Vector3f> node_displacements_mm(const ElasticGrid& grid, const ElasticField& unit_mm,
                                                   double force_N) {
  const ElasticBox& box = grid.box();
  std::vector<Eigen::Vector3f> displacement_mm(DisplacementField::node(box, 0, 0, box.cells[2] + 1));
  for (int k = 0; k <= box.cells[2]; ++k)
    for (int j = 0; j <= box.cells[1]; ++j)
      for (int i = 0; i <= box.cells[0]; ++i)
        for (int c = 0; c < 3; ++c)
          displacement_mm[DisplacementField::node(box, i, j, k)][c] =
              static_cast<float>(force_N * unit_mm.values[grid.layout().node(i, j, k, c)]);
  return displacement_mm;
}

std::vector<bool> empty_nodes(const ElasticGrid& grid) {
  const ElasticBox& box = grid.box();
  std::vector<bool> empty(DisplacementField::node(box, 0, 0, box.cells[2] + 1));
  for (int k = 0; k <= box.cells[2]; ++k)
    for (int j = 0; j <= box.cells[1]; ++j)
      for (int i = 0; i <= box.cells[0]; ++i)
        empty[DisplacementField::node(box, i, j, k)] = (grid.constraint(i, j, k) & ElasticGrid::kNoNode) != 0;
  return empty;
}

}  // namespace

DisplacedTissue::DisplacedTissue(const Model& model, const TickRecord& record) {
  if (model.labels == nullptr) return;
  if (is_elastic(model.tissue_law)) solve(model, record);
  if (model.tissue_law == TissueLaw::kChainMail) move(model, record);
}

void DisplacedTissue::move(const Model& model, const TickRecord& record) {
  constexpr int kPasses = 64;  // one second of frames
  const std::vector<ElasticMaterial> by_label = materials_of(model);
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    Dent dent;
    if (!find_dent(model, record, d, dent)) continue;
    const std::array<int, 3> first =
        first_cell_around(model, solver_box_centre(model, dent.at, dent.outward));
    const CarvedCells cells = solver_box_cells(model, by_label, {first, dent.at});
    ChainMail mail(cells.grid());
    mail.press(dent);
    mail.relax(kPasses);
    parts_.emplace_back(cells.grid(), mail.displacement_mm(), 1);
  }
}

void DisplacedTissue::solve(const Model& model, const TickRecord& record) {
  const std::vector<ElasticMaterial> by_label = materials_of(model);
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    Dent press;
    const double pressed_N = record.device[d].contact_N[0];  // contact with the deformable tissue only
    if (!find_dent(model, record, d, press) || !(pressed_N > 0 && std::isfinite(pressed_N))) continue;
    const std::array<int, 3> first =
        first_cell_around(model, solver_box_centre(model, press.at, press.outward));
    const CarvedCells cells = solver_box_cells(model, by_label, {first, press.at});
    const ElasticGrid& grid = cells.grid();
    const double cell_mm = grid.box().cell_mm, min_mm = kSolverSettings.min_patch_cells * cell_mm;
    const double modulus = PressurePatch(grid, press.at, press.outward, min_mm).contact_modulus_N_per_mm2();
    if (!(modulus > 0)) continue;
    const double touched_mm = cube_root(0.75 * pressed_N * press.radius_mm / modulus);
    const double rho_mm =
        std::clamp(touched_mm, min_mm, kMaxPatchRadiusFraction * grid.box().cells[1] * cell_mm);
    const PressurePatch patch(grid, press.at, press.outward, rho_mm);
    if (!patch.touches()) continue;
    ElasticField unit_mm(grid.layout()), load_N(grid.layout());
    patch.add(1, load_N);
    ElasticSolver(grid).solve(load_N, unit_mm, kMaxIterations, kConverged);
    double force_N = pressed_N;
    if (RelaxationWeights::is_needed_for(model)) {
      LocalCompliance local;
      local.compliance_mm_per_N = patch.displacement_mm(unit_mm);
      local.modulus_N_per_mm2 = patch.contact_modulus_N_per_mm2();
      local.patch_radius_mm = rho_mm;
      local.poissons_ratio = patch.poissons_ratio();
      local.compute_surroundings();
      force_N = instantaneous_force_N(record.device[d], contact_law_of(local), press.radius_mm,
                                      max_deformable_stiffness_N_per_mm(model));
    }
    parts_.emplace_back(grid, unit_mm, force_N);
  }
}

Vector<Patient> DisplacedTissue::displacement_mm(const Point<Patient>& at_rest) const {
  Vector<Patient> moved;
  for (const Part& part : parts_) part.moved().add_displacement(at_rest, moved);
  return moved;
}

double DisplacedTissue::strain(const Point<Patient>& at_rest) const {
  Eigen::Matrix3d slope = Eigen::Matrix3d::Zero();
  bool known = false;
  for (const Part& part : parts_) known = part.add_slope(at_rest, slope) || known;
  if (!known) return std::numeric_limits<double>::quiet_NaN();
  const Eigen::Matrix3d gradient = Eigen::Matrix3d::Identity() + slope;
  // an inverted cell counts as infinite strain
  if (!(gradient.determinant() > 0)) return std::numeric_limits<double>::infinity();
  const Eigen::Matrix3d back = gradient.inverse();
  Eigen::Matrix3d e = 0.5 * (Eigen::Matrix3d::Identity() - back.transpose() * back);
  e -= Eigen::Matrix3d::Identity() * (e.trace() / 3);
  return std::sqrt(e.squaredNorm() / 1.5);
}

DisplacedTissue::Part::Part(const ElasticGrid& grid, const ElasticField& unit_mm, double force_N)
    : moved_(grid.box(), node_displacements_mm(grid, unit_mm, force_N), empty_nodes(grid), kFadeCells) {
  compute_gradients(grid);
}

// Displacement gradient at cell centres, as in the solver (docs/concepts/tissue.md, "What is solved").
void DisplacedTissue::Part::compute_gradients(const ElasticGrid& grid) {
  const ElasticBox& box = moved_.box();
  const auto& cells = box.cells;
  slope_.resize(cell(0, 0, cells[2]), Eigen::Matrix3f::Zero());
  is_tissue_.resize(slope_.size());
  const float per_mm = static_cast<float>(0.25 / box.cell_mm);
  for (int k = 0; k < cells[2]; ++k)
    for (int j = 0; j < cells[1]; ++j)
      for (int i = 0; i < cells[0]; ++i) {
        if (!(grid.fill()[grid.layout().cell(i, j, k)] > 0)) continue;
        const std::size_t n = cell(i, j, k);
        is_tissue_[n] = true;
        for (int c = 0; c < 8; ++c) {
          const int up[3] = {c & 1, (c >> 1) & 1, c >> 2};
          const Eigen::Vector3f& moved = moved_.at(i + up[0], j + up[1], k + up[2]);
          for (int axis = 0; axis < 3; ++axis)
            slope_[n].col(axis) += (up[axis] != 0 ? per_mm : -per_mm) * moved;
        }
      }
}

bool DisplacedTissue::Part::add_slope(const Point<Patient>& at_rest, Eigen::Matrix3d& to) const {
  const ElasticBox& box = moved_.box();
  const Eigen::Vector3d in_cells = box.local_mm(at_rest) / box.cell_mm;
  for (int axis = 0; axis < 3; ++axis)
    if (!(in_cells[axis] > 0 && in_cells[axis] < box.cells[axis])) return false;
  const std::array<int, 3> last{box.cells[0] - 1, box.cells[1] - 1, box.cells[2] - 1};
  Eigen::Matrix3d slope = Eigen::Matrix3d::Zero();
  double known = 0;
  TrilinearWeights(in_cells - Eigen::Vector3d::Constant(0.5), last)
      .corners([&](int i, int j, int k, double weight) {
        if (!is_tissue_[cell(i, j, k)]) return;
        slope += weight * slope_[cell(i, j, k)].cast<double>();
        known += weight;
      });
  if (!(known > 0)) return false;
  to += box.axes * slope * box.axes.transpose() / known;
  return true;
}

}  // namespace palpate
