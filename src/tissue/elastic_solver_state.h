#pragma once

#include <cstdint>
#include <vector>

#include "palpate/tissue/elastic_solver.h"
#include "tissue/elastic_multigrid.h"

namespace palpate {

struct ElasticSolver::State {
  explicit State(const ElasticGrid& grid);
  /// What is held, displaced alone, asks of the others: |K u|.
  double held_norm(const ElasticField& u);

  ElasticGrid::LooseParts loose;
  std::vector<std::uint8_t> held;  ///< by the grid, and loose parts
  internal::elastic::Multigrid multigrid;
  ElasticValues r, z, p, q;   ///< of conjugate gradients
  ElasticValues step, tried;  ///< of Newton's method: where it goes, where it would be
};

}  // namespace palpate
