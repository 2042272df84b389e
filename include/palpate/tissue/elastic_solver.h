#pragma once

#include <memory>

#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// How a solution was come by.
struct ElasticSolution {
  int iterations = 0;
  /// |f - K u| / (|f| + the forces that what is held would make alone); 0 where there is no load.
  double residual = 0;
  bool converged = false;  ///< the residual is no more than was asked for
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

  /// Goes on from `displacement_mm`, whose held components stay as they are.
  /// @param force_N  of all nodes; where they are held it does not count
  /// @param tolerance  residual at which it stops
  ElasticSolution solve(const ElasticField& force_N, ElasticField& displacement_mm, int most_iterations,
                        double tolerance);
  /// Forces that hold the nodes displaced so; where nodes are free, what is left out of balance: K u
  /// everywhere.
  void forces(const ElasticField& displacement_mm, ElasticField& force_N);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace palpate
