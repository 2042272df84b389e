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
};

}  // namespace palpate
