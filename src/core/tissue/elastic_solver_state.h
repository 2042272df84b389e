#pragma once

#include <cstdint>
#include <vector>

#include "palpate/tissue/elastic_solver.h"
#include "tissue/elastic_multigrid.h"

namespace palpate {

struct ElasticSolver::State {
  explicit State(const ElasticGrid& grid);
  /// Norm |K u| over the free components, with u set to 0 there: the forces caused by the prescribed
  /// displacements alone. Overwrites p and q.
  double constrained_norm(const ElasticField& u);

  ElasticGrid::FloatingComponents floating_components;
  std::vector<std::uint8_t> constraints;  ///< Constraints of the grid and of floating components
  internal::elastic::Multigrid multigrid;
  /// Conjugate gradients: residual, preconditioned residual, search direction, and K times that direction.
  ElasticValues r, z, p, q;
  /// Newton's method: step, and trial displacement.
  ElasticValues step, tried;

  /// Linear solve in progress: its limits, the denominator of ElasticSolution::residual, and the product of r
  /// and z in the last iteration.
  ElasticSolution solution;
  int max_iterations = 0;
  double tolerance = 0, residual_norm_scale = 0, rz = 0;
  bool has_ended = true;
  double relative_residual() const;
  /// Sets `solution.residual`, and `has_ended` at the limits.
  void update_residual();
};

}  // namespace palpate
