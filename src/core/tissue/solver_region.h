#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/elastic_solver.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "tissue/relaxation_weights.h"
#include "tissue/solver_box.h"

/// Box of cells that SoftTissueSolver solves around a device's tool.
namespace palpate {

/// Residual (ElasticSolution::residual) at which linear solves stop before their maximum number of
/// iterations.
inline constexpr double kLinearTolerance = 1e-4;

/// Neo-Hookean body around a device's tool (docs/decisions/archive/0039-neo-hookean-in-the-tick.md).
///
/// u1: displacement of the linear body under 1 N on the patch; W = J u1 its mean displacement there, J the
/// patch's row of the contact Jacobian (PressurePatch); f(u): nodal forces of the neo-Hookean body.
///
/// The surface under the patch is constrained to s u1, the displacement of the linear body under a force s
/// (PressurePatch::columns). All other nodes equilibrate. A displacement is prescribed, because the pressure
/// of the patch as a dead load would pinch the tissue. For small strains the solution is the linear one,
/// u = s u1.
///
/// With E(s) the energy of the body, the patch bears the force F = E'(s) / W at a displacement of s W.
/// E'(s) = u1 . f(u), summed over all nodes. A deviation e from equilibrium has zero means under the patch,
/// J e = 0. Because K u1 = J^T, u1 . K e = J e = 0 as well, so that e changes F only to second order.
///
/// Moving the patch along the surface changes J, thereby u1. At a constant s, E then changes by s (dJ) y,
/// where K y = f(u). The law's tangential force, F^2 / 2 grad W - F^3 / 3 grad C, is minus the change of E at
/// a constant depth s W, i.e. -(s (dJ) y - F s grad W). With (dJ) u1 = grad W / 2 it follows that
///
///     F^3 / 3 grad C = F (F - s) / 2 grad W + s (dJ) (y - F u1)
struct SoftTissueSolver::NeoHookeanBody {
  ElasticField correction_mm;       ///< u - s u1; its means under the patch are 0
  ElasticField excess_response_mm;  ///< y - F u1: response of the linear body to the excess forces
  ElasticField u_mm, force_N;       ///< Scratch
  double indentation_mm = 0;        ///< Displacement of the patch, s W, in the last frame; 0: none
  /// Upper limit of indentation_mm as a fraction of the patch's radius: reduced when a solution fails, raised
  /// again after each success.
  double max_indentation_ratio = kSolverSettings.max_indentation;
  double depth_mm = 0;  ///< Predicted depth of the tool in the last frame; 0: no contact
  /// Depth of a tool at rest at which a solution failed. While the tool stays there, max_indentation_ratio is
  /// not raised. 0: none.
  double failed_depth_mm = 0;
  double stiffening_mm_per_N2 = 0, reference_force_N = 0;  ///< Last published C and F (LocalCompliance)

  explicit NeoHookeanBody(const ElasticLayout& layout)
      : correction_mm(layout), excess_response_mm(layout), u_mm(layout), force_N(layout) {}
  // discards the solution; max_indentation_ratio and depth_mm are retained
  void reset() {
    for (ElasticField* field : {&correction_mm, &excess_response_mm})
      std::fill(field->values.begin(), field->values.end(), 0.0f);
    indentation_mm = stiffening_mm_per_N2 = reference_force_N = failed_depth_mm = 0;
  }
};

/// Box of cells around a device's tool, with its solver and the state from which the next frame starts. The
/// caller prepares a new region's solver.
struct SoftTissueSolver::Region {
  std::vector<ElasticMaterial> by_label;  ///< Materials that the cells were made with
  SolverBox box;
  CarvedCells cells;
  ElasticSolver solver;
  /// u1, the displacements under 1 N on the patch, and the patch's nodal forces.
  ElasticField unit_mm, load_N;
  std::optional<RelaxationWeights> relaxation_weights;  ///< Unset: no tissue relaxes or stiffens
  double modulus_N_per_mm2 = 0;                         ///< Contact modulus under the patch in the last frame
  double radius_mm = 0;                                 ///< Radius of the tool in the last frame
  /// max_deformable_stiffness_N_per_mm() in the last frame
  double max_N_per_mm = std::numeric_limits<double>::infinity();
  bool needs_first_solve = true;                ///< The next solve counts as the first one in this box
  std::unique_ptr<NeoHookeanBody> neo_hookean;  ///< null: the law is linear

  /// @param before  region that this one replaces, whose solution is reused where both overlap; may be null
  Region(const Model& model, std::vector<ElasticMaterial> materials, const SolverBox& where,
         const Region* before)
      : by_label(std::move(materials)),
        box(where),
        cells(solver_box_cells(model, by_label, where)),
        solver(ElasticSolver::unprepared([&]() -> const ElasticGrid& {
          if (before != nullptr && before->was_made_from(cells.labels(), by_label))
            cells.copy_overlap(before->cells, cell_offset_to(*before));
          return cells.grid();
        }())),
        unit_mm(cells.grid().layout()),
        load_N(cells.grid().layout()) {
    if (is_hyperelastic(model.tissue_law)) neo_hookean = std::make_unique<NeoHookeanBody>(grid().layout());
    if (before != nullptr) copy_overlap(*before);
    if (RelaxationWeights::is_needed_for(model))
      relaxation_weights.emplace(model, cells.labels(), cells.grid());
  }

  const ElasticGrid& grid() const { return cells.grid(); }
  // whether the cells were made from these labels (before removal) and materials
  bool was_made_from(const CarvedLabels& labels, const std::vector<ElasticMaterial>& materials) const {
    return labels.original == cells.labels().original && by_label == materials;
  }
  // whether the region can be used for a model: its labels, materials, law and relaxation are unchanged
  bool was_made_from(const Model& model, const CarvedLabels& labels,
                     const std::vector<ElasticMaterial>& materials) const {
    return was_made_from(labels, materials) &&
           (neo_hookean != nullptr) == is_hyperelastic(model.tissue_law) &&
           relaxation_weights.has_value() == RelaxationWeights::is_needed_for(model) &&
           (!relaxation_weights || relaxation_weights->was_made_from(model));
  }
  // whether all cells have reached the state that corresponds to the removal in `labels`
  bool is_up_to_date(const CarvedLabels& labels) const {
    return labels.removed_fraction == cells.labels().removed_fraction && cells.changing_cells().empty();
  }

  // offset that added to a cell's index in this box gives its index in the box of `other`
  std::array<int, 3> cell_offset_to(const Region& other) const {
    const auto &here = box.first_cell, &there = other.box.first_cell;
    return {here[0] - there[0], here[1] - there[1], here[2] - there[2]};
  }
  // copies the solution where both boxes overlap, as initial guess
  void copy_overlap(const Region& before) {
    if (before.grid().layout().cells != grid().layout().cells) return;
    copy_overlap(before, before.unit_mm, unit_mm);
    if (neo_hookean == nullptr || before.neo_hookean == nullptr) return;
    copy_overlap(before, before.neo_hookean->correction_mm, neo_hookean->correction_mm);
    copy_overlap(before, before.neo_hookean->excess_response_mm, neo_hookean->excess_response_mm);
    neo_hookean->indentation_mm = before.neo_hookean->indentation_mm;
    neo_hookean->max_indentation_ratio = before.neo_hookean->max_indentation_ratio;
    neo_hookean->stiffening_mm_per_N2 = before.neo_hookean->stiffening_mm_per_N2;
    neo_hookean->reference_force_N = before.neo_hookean->reference_force_N;
  }
  void copy_overlap(const Region& before, const ElasticField& from, ElasticField& to) {
    const ElasticLayout& layout = grid().layout();
    const auto& all = layout.cells;
    const std::array<int, 3> offset = cell_offset_to(before);
    for (int k = 0; k <= all[2]; ++k)
      for (int j = 0; j <= all[1]; ++j)
        for (int i = 0; i <= all[0]; ++i) {
          const int a = i + offset[0], b = j + offset[1], c = k + offset[2];
          if (a < 0 || b < 0 || c < 0 || a > all[0] || b > all[1] || c > all[2]) continue;
          for (int axis = 0; axis < 3; ++axis)
            to.values[layout.node(i, j, k, axis)] = from.values[layout.node(a, b, c, axis)];
        }
    solver.zero_constrained(to);
  }
  // updates cells and solver after material was removed or restored since the last frame
  void follow(const CarvedLabels& labels) {
    if (cells.follow(labels, solver).empty()) return;
    solver.zero_constrained(unit_mm);
    if (neo_hookean == nullptr) return;
    solver.zero_constrained(neo_hookean->correction_mm);
    solver.zero_constrained(neo_hookean->excess_response_mm);
  }

  /// Solves the neo-Hookean body at the tool's predicted depth, and adds F, C and grad C to the local
  /// compliance of the linear solution.
  /// @param is_first_solve  whether this is the first solve in the box, with more iterations
  void solve_neo_hookean(const PressurePatch& patch, double depth_mm, bool is_first_solve,
                         LocalCompliance& local);
};

}  // namespace palpate
