#include "palpate/tissue/elastic_solver.h"

#include <cmath>
#include <utility>

#include "palpate/base/check.h"
#include "tissue/elastic_solver_state.h"

namespace palpate {

using internal::elastic::dot;
using internal::elastic::Operator;

ElasticSolver::State::State(const ElasticGrid& grid)
    : constraints(grid.constraints()),
      // members are initialised in the order of declaration: `floating_components` and `constraints` precede
      // the multigrid
      multigrid([&] {
        floating_components.constrain(grid, constraints);
        return Operator(grid.layout(), grid.box().cell_mm, grid.mu(), grid.lambda(), grid.springs(),
                        constraints, grid.stiffening());
      }()) {
  const std::size_t values = multigrid.finest().layout().node_values() + ElasticLayout::kSpare;
  for (ElasticValues* field : {&r, &z, &p, &q, &step, &tried}) field->assign(values, 0.0f);
}

void ElasticSolver::update_cells(const ElasticGrid& grid, const CellBox& cells, bool topology_changed) {
  if (cells.empty()) return;
  State& s = *state_;
  Operator& k = s.multigrid.finest();
  CellBox changed = cells;
  if (topology_changed) {
    s.constraints = grid.constraints();
    s.floating_components.constrain(grid, s.constraints);
    // Replacing cells can detach or reattach tissue at any distance from them. The box is extended to all
    // cells at nodes whose constraints changed.
    const ElasticLayout& layout = grid.layout();
    for (int c = 0; c <= layout.cells[2]; ++c)
      for (int b = 0; b <= layout.cells[1]; ++b)
        for (int a = 0; a <= layout.cells[0]; ++a) {
          const std::size_t node = grid.node_number(a, b, c);
          if (s.constraints[node] == k.constraints()[node] || changed.contains_node(a, b, c)) continue;
          changed = changed.joined(CellBox{{a, b, c}, {a, b, c}}.grown(1).clipped(layout.cells));
        }
  }
  k.change(grid.mu(), grid.lambda(), grid.springs(), s.constraints, changed, grid.stiffening());
  s.multigrid.update(changed);
}

void ElasticSolver::zero_constrained(ElasticField& displacement_mm) const {
  const Operator& k = state_->multigrid.finest();
  for (std::size_t n = 0; n < displacement_mm.values.size(); ++n)
    if (!k.free(n)) displacement_mm.values[n] = 0;
}

double ElasticSolver::State::constrained_norm(const ElasticField& u) {
  Operator& k = multigrid.finest();
  bool any = false;
  for (std::size_t n = 0; n < p.size(); ++n) {
    p[n] = k.free(n) ? 0.0f : u.values[n];
    any = any || p[n] != 0;
  }
  if (!any) return 0;
  k.apply(p, q);
  return std::sqrt(dot(q, q));
}

double ElasticSolver::State::relative_residual() const {
  const double norm = std::sqrt(dot(r, r));
  return residual_norm_scale > 0 ? norm / residual_norm_scale : norm;
}

void ElasticSolver::State::update_residual() {
  solution.residual = relative_residual();
  solution.converged = solution.residual <= tolerance;
  has_ended = solution.converged || solution.iterations >= max_iterations;
}

ElasticSolver::ElasticSolver(std::unique_ptr<State> state) : state_(std::move(state)) {}
ElasticSolver::ElasticSolver(const ElasticGrid& grid) : ElasticSolver(unprepared(grid)) {
  while (!prepare()) {
  }
}
ElasticSolver ElasticSolver::unprepared(const ElasticGrid& grid) {
  return ElasticSolver(std::make_unique<State>(grid));
}
ElasticSolver::~ElasticSolver() = default;
ElasticSolver::ElasticSolver(ElasticSolver&&) noexcept = default;
ElasticSolver& ElasticSolver::operator=(ElasticSolver&&) noexcept = default;

const ElasticLayout& ElasticSolver::layout() const {
  return state_->multigrid.finest().layout();
}

bool ElasticSolver::prepare() {
  return state_->multigrid.prepare();
}

void ElasticSolver::forces(const ElasticField& displacement_mm, ElasticField& force_N) {
  state_->multigrid.finest().apply_everywhere(displacement_mm.values, force_N.values);
}

ElasticSolution ElasticSolver::solve(const ElasticField& force_N, ElasticField& displacement_mm,
                                     int max_iterations, double tolerance) {
  begin_solve(force_N, displacement_mm, max_iterations, tolerance);
  while (!iterate(displacement_mm)) {
  }
  return solution();
}

void ElasticSolver::begin_solve(const ElasticField& force_N, const ElasticField& displacement_mm,
                                int max_iterations, double tolerance) {
  State& s = *state_;
  Operator& k = s.multigrid.finest();
  const ElasticValues& u = displacement_mm.values;
  PALPATE_CHECK(u.size() == s.r.size() && force_N.values.size() == s.r.size());
  s.solution = {};
  s.max_iterations = max_iterations;
  s.tolerance = tolerance;
  s.rz = 0;

  // initial residual, and the load that it is relative to
  s.residual_norm_scale = s.constrained_norm(displacement_mm);
  k.apply(u, s.q);
  double squared_load = 0;
  for (std::size_t n = 0; n < u.size(); ++n) {
    const float f = k.free(n) ? force_N.values[n] : 0.0f;
    squared_load += static_cast<double>(f) * f;
    s.r[n] = f - s.q[n];
  }
  s.residual_norm_scale += std::sqrt(squared_load);
  s.update_residual();
}

// one iteration of preconditioned conjugate gradients
bool ElasticSolver::iterate(ElasticField& displacement_mm) {
  State& s = *state_;
  if (s.has_ended) return true;
  Operator& k = s.multigrid.finest();
  ElasticValues& u = displacement_mm.values;
  s.has_ended = true;
  s.multigrid.cycle(s.r, s.z);
  const double rz_next = dot(s.r, s.z);
  // the V-cycle is positive definite, so this fails only if the residual is rounding error or not finite
  if (!(rz_next > 0) || !std::isfinite(rz_next)) return true;
  const float beta = s.solution.iterations == 0 ? 0.0f : static_cast<float>(rz_next / s.rz);
  s.rz = rz_next;
  for (std::size_t n = 0; n < u.size(); ++n) s.p[n] = s.z[n] + beta * s.p[n];
  k.apply(s.p, s.q);
  const double pq = dot(s.p, s.q);
  if (!(pq > 0) || !std::isfinite(pq)) return true;
  const float alpha = static_cast<float>(s.rz / pq);
  for (std::size_t n = 0; n < u.size(); ++n) {
    u[n] += alpha * s.p[n];
    s.r[n] -= alpha * s.q[n];
  }
  ++s.solution.iterations;
  s.update_residual();
  return s.has_ended;
}

const ElasticSolution& ElasticSolver::solution() const {
  return state_->solution;
}

}  // namespace palpate
