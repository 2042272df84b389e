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
  /// |f - K u| / (|f| + norm of the forces caused by prescribed displacements alone); 0 without a load.
  double residual = 0;
  bool converged = false;  ///< The residual is within the tolerance
};

/// Weighted means of a field's values that are constrained to 0. No value belongs to two means. A mean is a
/// node's component (one value, weight 1) or the point at which an edge between two nodes crosses a surface.
class HeldMeans {
 public:
  struct Weight {
    std::uint32_t value;
    float weight;
  };
  /// Adds a mean.
  /// @param weights  not all 0
  void add(std::span<const Weight> weights);
  /// Changes a field by the least amount (in the Euclidean norm) that makes the means 0.
  void take_out(ElasticValues& of) const;
  /// Norm of the component that take_out() removes.
  double norm(const ElasticValues& of) const;

 private:
  std::vector<Weight> weights_;    ///< Normalised: the squares of a mean's weights sum to 1
  std::vector<std::size_t> ends_;  ///< End of each mean's weights
};

/// Convergence of a neo-Hookean solution.
struct FiniteSolution {
  int steps = 0;       ///< Newton steps
  int iterations = 0;  ///< Conjugate gradient iterations in all steps
  double residual = 0;
  bool converged = false;
  /// Least det F of all cells: the remaining volume fraction of the most compressed one.
  double min_volume = 1;
  /// The last step failed: at the shortest length it would still have inverted a cell or not reduced the
  /// residual.
  bool stuck = false;
};
/// Limits of a neo-Hookean solution.
struct FiniteSettings {
  int max_steps = 1;
  int max_iterations = 8;   ///< Conjugate gradient iterations per step
  double tolerance = 1e-3;  ///< Residual at which it stops
  /// Relative residual at which the conjugate gradients of a step stop.
  double step_tolerance = 0.1;
  /// No step may leave a cell with less than this volume fraction, unless the least volume grows.
  double min_volume = 0.1;
};

/// Linear elasticity of a grid: solves K u = f by conjugate gradients, preconditioned by a multigrid V-cycle.
/// All memory is allocated by the constructor; solves allocate nothing. One instance per thread.
/// Bit-identical on every SIMD target.
class ElasticSolver {
 public:
  /// Copies the necessary data of the grid and holds its loose parts.
  explicit ElasticSolver(const ElasticGrid& grid);
  ~ElasticSolver();
  ElasticSolver(ElasticSolver&&) noexcept;
  ElasticSolver& operator=(ElasticSolver&&) noexcept;

  const ElasticLayout& layout() const;

  /// Updates the solver after ElasticGrid::set_cells changed some cells, in place. Cost and memory are
  /// proportional to their box. Later solutions equal those of a new solver for the grid, though the number
  /// of iterations may differ.
  /// @param other  return value of set_cells()
  void change(const ElasticGrid& grid, const CellBox& cells, bool other);
  /// Sets the displacements of all held components to 0.
  void zero_held(ElasticField& displacement_mm) const;

  /// Solves with `displacement_mm` as initial guess; its held components are prescribed.
  /// @param force_N    forces on all nodes; ignored where components are held
  /// @param tolerance  residual at which it stops
  ElasticSolution solve(const ElasticField& force_N, ElasticField& displacement_mm, int max_iterations,
                        double tolerance);
  /// Solves the same body as neo-Hookean, which equals linear elasticity for small strains, by Newton's
  /// method from `displacement_mm`. If prescribed displacements have changed, first add the linear response
  /// (`solve` from 0 for the change), so that no cell next to them is inverted.
  /// @param held  constraints besides the nodes held by the grid; a few, for which the solver need not be
  ///              rebuilt
  FiniteSolution solve_neo_hookean(const ElasticField& force_N, ElasticField& displacement_mm,
                                   const FiniteSettings& settings, const HeldMeans& held = {});
  /// Nodal forces of the neo-Hookean body, like forces().
  void finite_forces(const ElasticField& displacement_mm, ElasticField& force_N);

  /// Nodal forces K u everywhere: at held nodes the reaction, at free nodes the imbalance.
  void forces(const ElasticField& displacement_mm, ElasticField& force_N);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace palpate
