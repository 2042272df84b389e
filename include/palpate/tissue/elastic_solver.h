#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// Convergence of a linear solution.
struct ElasticSolution {
  int iterations = 0;
  /// |f - K u| / (|f| + norm of the forces caused by prescribed displacements alone), over the free
  /// components. If both terms of the denominator are 0: |K u|, N.
  double residual = 0;
  bool converged = false;  ///< The residual is within the tolerance
};

/// Linear constraints on a field: weighted means of its values that are constrained to 0. No value belongs to
/// two means. A mean represents one component of a node (one value, weight 1), or of the point at which an
/// edge between nodes crosses a surface.
class ConstrainedMeans {
 public:
  struct Weight {
    std::uint32_t value;
    float weight;
  };
  /// Adds a mean.
  /// @param weights  not all 0
  void add(std::span<const Weight> weights);
  /// Projects a field orthogonally (in the Euclidean norm) onto the fields whose means are 0.
  void project_out(ElasticValues& of) const;
  /// Euclidean norm of the component that project_out() removes.
  double norm(const ElasticValues& of) const;

 private:
  std::vector<Weight> weights_;    ///< Normalised: the squares of a mean's weights sum to 1
  std::vector<std::size_t> ends_;  ///< End of each mean's weights
};

/// Convergence of a neo-Hookean solution.
struct NeoHookeanSolution {
  int steps = 0;       ///< Newton steps
  int iterations = 0;  ///< Conjugate gradient iterations in all steps
  /// As ElasticSolution::residual, with the norm of the initial constraint forces of the ConstrainedMeans
  /// added to the denominator.
  double residual = 0;
  bool converged = false;  ///< The residual is within the tolerance
  /// Least det F of all cells, F being the deformation gradient: the remaining volume fraction of the most
  /// compressed one.
  double min_volume = 1;
  /// The line search of the last step failed: even the shortest step would have compressed a cell below
  /// NeoHookeanSettings::min_volume or not reduced the residual along the step.
  bool line_search_failed = false;
};
/// Limits of a neo-Hookean solution.
struct NeoHookeanSettings {
  int max_steps = 1;
  int max_iterations = 8;   ///< Conjugate gradient iterations per step
  double tolerance = 1e-3;  ///< NeoHookeanSolution::residual at which Newton's method stops
  /// Residual at which the conjugate gradients of a step stop, relative to the residual before the step.
  double step_tolerance = 0.1;
  /// A step that leaves a cell with less than this volume fraction is rejected, unless it increases the least
  /// volume.
  double min_volume = 0.1;
};

/// Linear elasticity of a grid: solves K u = f by conjugate gradients, preconditioned by a multigrid V-cycle.
/// Solves do not allocate. One instance per thread. Bit-identical on every SIMD target.
///
/// Preparation and linear solves can be divided into steps, between which a host without threads does other
/// work; the results are the same to the bit.
///
/// A component of a node's displacement is either constrained (prescribed) or free.
class ElasticSolver {
 public:
  /// Copies the required data from the grid, and constrains floating components
  /// (ElasticGrid::constrain_floating_components()).
  explicit ElasticSolver(const ElasticGrid& grid);
  /// Solver that is prepared by the caller: until prepare() has returned true, no other function but layout()
  /// and zero_constrained() may be called.
  static ElasticSolver unprepared(const ElasticGrid& grid);
  ~ElasticSolver();
  ElasticSolver(ElasticSolver&&) noexcept;
  ElasticSolver& operator=(ElasticSolver&&) noexcept;

  const ElasticLayout& layout() const;

  /// Advances the preparation by one step, which takes about as long as an iteration of solve(), or less.
  /// @returns whether the preparation is complete
  bool prepare();

  /// Updates the solver in place after ElasticGrid::set_cells() changed some cells. Solutions converge to
  /// those of a new solver for the grid, though the number of iterations may differ, because the eigenvalue
  /// bounds of the smoothers never decrease. Operators are updated in the box of the changed cells only; the
  /// coarsest grid is factorised again.
  /// @param cells             box passed to set_cells()
  /// @param topology_changed  return value of set_cells(): whether the set of soft cells or of constrained
  ///                          nodes has changed. If true, floating components are searched again, which
  ///                          visits the whole grid
  void update_cells(const ElasticGrid& grid, const CellBox& cells, bool topology_changed);
  /// Sets the displacements of all constrained components to 0.
  void zero_constrained(ElasticField& displacement_mm) const;

  /// Solves for the free components of `displacement_mm`, whose values are the initial guess. Its constrained
  /// components are the prescribed displacements and do not change.
  /// @param force_N    forces on all nodes; ignored for constrained components
  /// @param tolerance  ElasticSolution::residual at which it stops
  ElasticSolution solve(const ElasticField& force_N, ElasticField& displacement_mm, int max_iterations,
                        double tolerance);
  /// Begins a solve() whose iterations are made by iterate(). The arguments are those of solve().
  void begin_solve(const ElasticField& force_N, const ElasticField& displacement_mm, int max_iterations,
                   double tolerance);
  /// Makes one iteration of the solve begun last.
  /// @param displacement_mm  field passed to begin_solve(), unchanged since the last iteration
  /// @returns whether the solve has ended
  bool iterate(ElasticField& displacement_mm);
  /// Convergence of the linear solve begun last.
  const ElasticSolution& solution() const;
  /// Solves the same body under the neo-Hookean law, which equals linear elasticity for small strains, by
  /// Newton's method with `displacement_mm` as initial guess. If prescribed displacements have changed since
  /// the guess was computed, add the linear response to the change (`solve` from 0) to it first: otherwise
  /// cells next to these nodes may be inverted.
  /// @param constraints  constraints in addition to the constrained components. They are projected out in
  ///                     every iteration, so the operators need not be rebuilt
  NeoHookeanSolution solve_neo_hookean(const ElasticField& force_N, ElasticField& displacement_mm,
                                       const NeoHookeanSettings& settings,
                                       const ConstrainedMeans& constraints = {});
  /// Nodal forces of the neo-Hookean body, like forces().
  void neo_hookean_forces(const ElasticField& displacement_mm, ElasticField& force_N);

  /// Nodal forces K u everywhere: at constrained nodes the reaction, at free nodes the imbalance.
  void forces(const ElasticField& displacement_mm, ElasticField& force_N);

 private:
  struct State;
  explicit ElasticSolver(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace palpate
