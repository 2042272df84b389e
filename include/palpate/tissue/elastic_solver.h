#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// How a solution was come by.
struct ElasticSolution {
  int iterations = 0;
  /// |f - K u| / (|f| + the forces that what is held would make alone); 0 where there is no load.
  double residual = 0;
  bool converged = false;  ///< the residual is no more than was asked for
};

/// Weighted means of a field's values that are held as they are, each of values that belong to no other: a
/// node (one value, weight 1), or the place at which an edge between two nodes goes through a surface.
class HeldMeans {
 public:
  struct Weight {
    std::uint32_t value;
    float weight;
  };
  /// One more. @param weights  not all 0
  void add(std::span<const Weight> weights);
  /// Moves a field as little as makes its means 0.
  void take_out(ElasticValues& of) const;
  /// The part of a field that `take_out` takes, its norm.
  double norm(const ElasticValues& of) const;

 private:
  std::vector<Weight> weights_;    ///< the squares of a mean's sum to 1
  std::vector<std::size_t> ends_;  ///< of each mean's weights
};

/// How a neo-Hookean solution was come by.
struct FiniteSolution {
  int steps = 0;       ///< of Newton's method
  int iterations = 0;  ///< of conjugate gradients, in all of them
  double residual = 0;
  bool converged = false;
  /// Least det F of all cells: what is left of the volume of the one that is pressed most.
  double least_volume = 1;
  /// A step came to nothing: shortened as far as it may be it would still have turned a cell inside out, or
  /// made nothing better.
  bool stuck = false;
};
/// What bounds such a solution.
struct FiniteSettings {
  int most_steps = 1;
  int most_iterations = 8;  ///< of conjugate gradients in a step
  double tolerance = 1e-3;  ///< residual at which it stops
  /// Of the residual, left by the conjugate gradients of a step.
  double step_tolerance = 0.1;
  /// No step leaves a cell with less of its volume, unless it had less before and has more then.
  double least_volume = 0.1;
};

/// Linear elasticity of a grid: K u = f by conjugate gradients, preconditioned by a V-cycle of multigrid. Its
/// memory is taken when it is made; what it is asked then allocates nothing. For one thread; another thread
/// needs a solver of its own. The same bits on every SIMD target.
class ElasticSolver {
 public:
  /// Copies what it needs of the grid, loose parts held.
  explicit ElasticSolver(const ElasticGrid& grid);
  ~ElasticSolver();
  ElasticSolver(ElasticSolver&&) noexcept;
  ElasticSolver& operator=(ElasticSolver&&) noexcept;

  const ElasticLayout& layout() const;

  /// Some of the grid's cells are others now (ElasticGrid::set_cells), in place: the work goes with their
  /// box, and what it needs of memory with that, too. What it then solves is what a new solver of the grid
  /// would; it may take another number of iterations.
  /// @param other  what set_cells has returned
  void change(const ElasticGrid& grid, const CellBox& cells, bool other);
  /// 0 wherever nodes are held.
  void put_at_rest(ElasticField& displacement_mm) const;

  /// Goes on from `displacement_mm`, whose held components stay as they are.
  /// @param force_N  of all nodes; where they are held it does not count
  /// @param tolerance  residual at which it stops
  ElasticSolution solve(const ElasticField& force_N, ElasticField& displacement_mm, int most_iterations,
                        double tolerance);
  /// The same body as a neo-Hookean one, which is linear elasticity where strains are small: by Newton's
  /// method from `displacement_mm` on. Where what is held has moved since, let the others go with it first
  /// (`solve` from 0 for the way it moved, added), so that no cell beside it is turned inside out.
  /// @param held  what stays as it is besides nodes that the grid holds: a few, for which the solver need not
  ///              be made anew
  FiniteSolution solve_finite(const ElasticField& force_N, ElasticField& displacement_mm,
                              const FiniteSettings& settings, const HeldMeans& held = {});
  /// As `forces`, of the neo-Hookean body.
  void finite_forces(const ElasticField& displacement_mm, ElasticField& force_N);

  /// Forces that hold the nodes displaced so; where nodes are free, what is left out of balance: K u
  /// everywhere.
  void forces(const ElasticField& displacement_mm, ElasticField& force_N);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace palpate
