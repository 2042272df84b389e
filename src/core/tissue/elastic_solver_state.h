#pragma once

#include <cstdint>
#include <vector>

#include "palpate/tissue/elastic_solver.h"
#include "tissue/elastic_multigrid.h"

namespace palpate {

struct ElasticSolver::State {
  explicit State(const ElasticGrid& grid);
  /// Norm |K u| of the free nodal forces caused by the prescribed displacements alone.
  double held_norm(const ElasticField& u);

  ElasticGrid::LooseParts loose;
  std::vector<std::uint8_t> held;  ///< Constraints of the grid and of loose parts
  internal::elastic::Multigrid multigrid;
  ElasticValues r, z, p, q;   ///< Conjugate gradients
  ElasticValues step, tried;  ///< Newton's method: step and trial displacement
};

}  // namespace palpate
