#include <algorithm>
#include <cmath>

#include "tissue/elastic_solver_state.h"

namespace palpate {

using internal::elastic::dot;
using internal::elastic::Operator;

namespace {

/// Line search: maximum number of halvings, and fraction of the initial directional residual below which a
/// step is accepted.
constexpr int kMaxHalvings = 6;
constexpr double kMaxSlopeRatio = 0.9;

}  // namespace

void ConstrainedMeans::add(std::span<const Weight> weights) {
  double squares = 0;
  for (const Weight& one : weights) squares += static_cast<double>(one.weight) * one.weight;
  PALPATE_CHECK(squares > 0);
  const double by = 1 / std::sqrt(squares);
  for (const Weight& one : weights) weights_.push_back({one.value, static_cast<float>(by * one.weight)});
  ends_.push_back(weights_.size());
}

void ConstrainedMeans::project_out(ElasticValues& of) const {
  std::size_t first = 0;
  for (const std::size_t end : ends_) {
    float mean = 0;
    for (std::size_t n = first; n < end; ++n) mean += weights_[n].weight * of[weights_[n].value];
    for (; first < end; ++first) of[weights_[first].value] -= mean * weights_[first].weight;
  }
}

double ConstrainedMeans::norm(const ElasticValues& of) const {
  double squares = 0;
  std::size_t first = 0;
  for (const std::size_t end : ends_) {
    double mean = 0;
    for (; first < end; ++first)
      mean += static_cast<double>(weights_[first].weight) * of[weights_[first].value];
    squares += mean * mean;
  }
  return std::sqrt(squares);
}

void ElasticSolver::neo_hookean_forces(const ElasticField& displacement_mm, ElasticField& force_N) {
  state_->multigrid.finest().apply_finite_strain_everywhere(displacement_mm.values, force_N.values);
}

NeoHookeanSolution ElasticSolver::solve_neo_hookean(const ElasticField& force_N,
                                                    ElasticField& displacement_mm,
                                                    const NeoHookeanSettings& settings,
                                                    const ConstrainedMeans& constraints) {
  State& s = *state_;
  Operator& k = s.multigrid.finest();
  ElasticValues& u = displacement_mm.values;
  PALPATE_CHECK(u.size() == s.r.size() && force_N.values.size() == s.r.size());
  NeoHookeanSolution solution;
  // residual r = f - forces(at); returns the least volume fraction
  const auto update_residual = [&](const ElasticValues& at) {
    const double smallest = k.apply_finite_strain(at, s.q);
    for (std::size_t n = 0; n < u.size(); ++n) s.r[n] = k.free(n) ? force_N.values[n] - s.q[n] : 0.0f;
    constraints.project_out(s.r);
    return smallest;
  };
  double load = 0;
  for (std::size_t n = 0; n < u.size(); ++n)
    if (k.free(n)) load += static_cast<double>(force_N.values[n]) * force_N.values[n];
  double scale = std::sqrt(load) + s.constrained_norm(displacement_mm);
  const auto relative_residual = [&] {
    const double norm = std::sqrt(dot(s.r, s.r));
    return scale > 0 ? norm / scale : norm;
  };

  solution.min_volume = update_residual(u);
  scale += constraints.norm(s.q);
  solution.residual = relative_residual();
  while (solution.residual > settings.tolerance && solution.steps < settings.max_steps) {
    // Solves T step = r by conjugate gradients, truncated where the tangent T is not positive definite.
    std::fill(s.step.begin(), s.step.end(), 0.0f);
    s.tried = s.r;
    double rz = 0;
    const double enough = settings.step_tolerance * std::sqrt(dot(s.r, s.r));
    for (int n = 0; n < settings.max_iterations && std::sqrt(dot(s.r, s.r)) > enough; ++n) {
      // The V-cycle ignores the additional constraints. They are projected out of its result, which keeps it
      // symmetric positive definite on the remaining components.
      s.multigrid.cycle(s.r, s.z);
      constraints.project_out(s.z);
      const double next = dot(s.r, s.z);
      if (!(next > 0) || !std::isfinite(next)) break;
      const float beta = n == 0 ? 0.0f : static_cast<float>(next / rz);
      rz = next;
      for (std::size_t m = 0; m < u.size(); ++m) s.p[m] = s.z[m] + beta * s.p[m];
      k.apply_tangent(u, s.p, s.q);
      constraints.project_out(s.q);
      const double pq = dot(s.p, s.q);
      if (!(pq > 0) || !std::isfinite(pq)) {
        if (n == 0) s.step = s.p;
        break;
      }
      const float alpha = static_cast<float>(rz / pq);
      for (std::size_t m = 0; m < u.size(); ++m) {
        s.step[m] += alpha * s.p[m];
        s.r[m] -= alpha * s.q[m];
      }
      ++solution.iterations;
    }
    const double initial_slope = dot(s.tried, s.step);

    // longest step that inverts no cell and reduces the residual along the step
    double length = 1, least = 0;
    bool good = false;
    for (int n = 0; n <= kMaxHalvings && !good; ++n, length /= 2) {
      for (std::size_t m = 0; m < u.size(); ++m) s.tried[m] = u[m] + static_cast<float>(length) * s.step[m];
      least = update_residual(s.tried);
      good = (least >= settings.min_volume || least > solution.min_volume) &&
             std::abs(dot(s.r, s.step)) <= kMaxSlopeRatio * std::abs(initial_slope);
    }
    if (!good) {
      solution.line_search_failed = true;
      update_residual(u);
      break;
    }
    u = s.tried;
    solution.min_volume = least;
    solution.residual = relative_residual();
    ++solution.steps;
  }
  solution.converged = solution.residual <= settings.tolerance;
  return solution;
}

}  // namespace palpate
