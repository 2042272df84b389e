#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>

#include "base/test_seed.h"
#include "palpate/tissue/elastic_solver.h"
#include "sampling/test_targets.h"
#include "tissue/elastic_solver_state.h"
#include "tissue/test_elastic_oracle.h"
#include "tissue/test_elastic_scenes.h"

namespace palpate {
namespace {

using testing::SlowElastic;
using testing::soft;

/// Energy of a cell, in double, with the hourglass modes of the linear element.
double cell_energy(double mu, double lambda, double h, const Eigen::Matrix<double, 24, 1>& u) {
  Eigen::Matrix3d f = Eigen::Matrix3d::Identity();
  for (int corner = 0; corner < 8; ++corner)
    for (int a = 0; a < 3; ++a)
      f.col(a) += ((corner >> a & 1) != 0 ? 1 : -1) / (4 * h) * u.segment<3>(3 * corner);
  const double volume = f.determinant();
  const double density =
      mu / 2 * (f.squaredNorm() - 3) - mu * (volume - 1) + (lambda + mu) / 2 * std::pow(volume - 1, 2);
  // hourglass part of the linear cell: zero for uniform strain
  const testing::CellStiffness all = testing::cell_stiffness(mu, lambda, h),
                               even = testing::cell_stiffness(mu, lambda, h, 0);
  return density * h * h * h + u.dot((all - even) * u) / 2;
}

double energy_of(const ElasticGrid& grid, const Eigen::VectorXd& u) {
  const SlowElastic slow(grid);
  const ElasticLayout& layout = grid.layout();
  double energy = 0;
  for (int k = 0; k < layout.cells[2]; ++k)
    for (int j = 0; j < layout.cells[1]; ++j)
      for (int i = 0; i < layout.cells[0]; ++i) {
        Eigen::Matrix<double, 24, 1> local;
        for (int corner = 0; corner < 8; ++corner)
          local.segment<3>(3 * corner) =
              u.segment<3>(3 * slow.number(i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2 & 1)));
        const std::size_t cell = layout.cell(i, j, k);
        energy += cell_energy(grid.mu()[cell], grid.lambda()[cell], grid.box().cell_mm, local);
      }
  return energy;
}

ElasticField random_displacement(const ElasticGrid& grid, float most, std::mt19937& random) {
  std::uniform_real_distribution<float> between(-most, most);
  ElasticField field(grid.layout());
  SlowElastic(grid).for_each_node([&](int i, int j, int k) {
    for (int c = 0; c < 3; ++c) field.values[grid.layout().node(i, j, k, c)] = between(random);
  });
  return field;
}

TEST(ElasticFinite, ForcesAreTheSlopeOfTheEnergy) {
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> unit(0, 1);
  const ElasticGrid grid(
      testing::elastic_box({3, 2, 2}, 0.8),
      [&](const Point<Patient>&) { return soft(5 + 50 * unit(random), 0.4); }, 1);
  const ElasticField u = random_displacement(grid, 0.15f, random);
  ElasticSolver solver(grid);
  ElasticField force(grid.layout());
  solver.finite_forces(u, force);
  const SlowElastic slow(grid);
  const Eigen::VectorXd at = slow.from(u), reported = slow.from(force);
  for (int n = 0; n < slow.values(); ++n) {
    const Eigen::VectorXd step = 1e-5 * Eigen::VectorXd::Unit(slow.values(), n);
    EXPECT_NEAR((energy_of(grid, at + step) - energy_of(grid, at - step)) / 2e-5, reported[n],
                1e-5 * reported.cwiseAbs().maxCoeff());
  }
}

TEST(ElasticFinite, TheTangentIsTheSlopeOfTheForcesOnEverySimdTarget) {
  std::mt19937 random(test::test_seed());
  ElasticGrid grid = testing::random_grid({18, 3, 3}, 0.7, random);
  internal::elastic::Multigrid multigrid([&] {
    std::vector<std::uint8_t> free(grid.layout().node_values() / 3 + ElasticLayout::kSpare, 0);
    return internal::elastic::Operator(grid.layout(), 0.7, grid.mu(), grid.lambda(), grid.springs(), free);
  }());
  internal::elastic::Operator& k = multigrid.finest();
  const ElasticField u = random_displacement(grid, 0.1f, random), path = random_displacement(grid, 1, random);
  ElasticField high = u, low = u, at_high(grid.layout()), at_low(grid.layout()), reported(grid.layout()),
               first;
  constexpr float kStep = 1e-3f;
  for (std::size_t n = 0; n < u.values.size(); ++n) {
    high.values[n] += kStep * path.values[n];
    low.values[n] -= kStep * path.values[n];
  }
  for (const std::int64_t target : test::all_targets()) {
    SCOPED_TRACE(test::target_name(target));
    const test::OnlyTargets only(target);
    k.apply_finite(high.values, at_high.values);
    k.apply_finite(low.values, at_low.values);
    k.apply_tangent(u.values, path.values, reported.values);
    double most = 0, off = 0;
    for (std::size_t n = 0; n < u.values.size(); ++n) {
      const double slope = (static_cast<double>(at_high.values[n]) - at_low.values[n]) / (2 * kStep);
      most = std::max(most, std::abs(slope));
      off = std::max(off, std::abs(slope - reported.values[n]));
    }
    EXPECT_LE(off, 2e-3 * most);
    if (first.values.empty()) first = reported;
    ASSERT_EQ(
        std::memcmp(reported.values.data(), first.values.data(), reported.values.size() * sizeof(float)), 0);
  }
}

TEST(ElasticFinite, TurningAsFarAsItMayMakesNoForce) {
  const ElasticGrid grid = testing::elastic_block({7, 5, 6}, 0.9, soft(10, 0.45));
  ElasticSolver solver(grid);
  ElasticField u(grid.layout()), force(grid.layout());
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(2.2, Eigen::Vector3d(1, 2, -0.5).normalized()).toRotationMatrix();
  const SlowElastic slow(grid);
  const auto max_force = [&](double stretch) {
    slow.for_each_node([&](int i, int j, int k) {
      const Eigen::Vector3d x = 0.9 * Eigen::Vector3d(i, j, k), moved = stretch * turn * x - x;
      for (int c = 0; c < 3; ++c) u.values[grid.layout().node(i, j, k, c)] = static_cast<float>(moved[c]);
    });
    solver.finite_forces(u, force);
    return slow.from(force).cwiseAbs().maxCoeff();
  };
  EXPECT_LE(max_force(1), 1e-4 * max_force(1.1));
}

TEST(ElasticFinite, SmallStrainsAreLinear) {
  std::mt19937 random(test::test_seed());
  const ElasticGrid grid = testing::elastic_block({6, 5, 4}, 1, soft(10, 0.45));
  ElasticSolver solver(grid);
  ElasticField linear(grid.layout()), finite(grid.layout());
  const ElasticField u = random_displacement(grid, 1e-3f, random);
  solver.forces(u, linear);
  solver.finite_forces(u, finite);
  const SlowElastic slow(grid);
  EXPECT_LE((slow.from(linear) - slow.from(finite)).cwiseAbs().maxCoeff(),
            5e-3 * slow.from(linear).cwiseAbs().maxCoeff());
}

TEST(ElasticFinite, WhatIsHeldBesidesIsHeldAsByTheGrid) {
  ElasticGrid grid = testing::elastic_block({15, 12, 6}, 1, soft(10, 0.45));
  for (int j = 0; j <= 12; ++j)
    for (int i = 0; i <= 15; ++i) grid.hold(i, j, 0, ElasticGrid::kHeld);
  const ElasticLayout& layout = grid.layout();
  ElasticSolver solver(grid);
  ElasticField load(layout), besides(layout);
  HeldMeans held;
  for (int j = 5; j <= 7; ++j)
    for (int i = 6; i <= 8; ++i) {
      grid.hold(i, j, 6, ElasticGrid::kHeld);
      for (int c = 0; c < 3; ++c) {
        const HeldMeans::Weight one{static_cast<std::uint32_t>(layout.node(i, j, 6, c)), 2};
        held.add({&one, 1});
      }
      besides.values[layout.node(i, j, 6, 2)] = -0.5f;
    }
  ElasticField by_grid = besides;
  FiniteSettings settings;
  settings.max_steps = 40;
  settings.max_iterations = 60;
  settings.tolerance = 2e-5;  // about the precision of floats
  EXPECT_TRUE(solver.solve_neo_hookean(load, besides, settings, held).converged);
  EXPECT_TRUE(ElasticSolver(grid).solve_neo_hookean(load, by_grid, settings).converged);
  for (std::size_t n = 0; n < by_grid.values.size(); ++n)
    ASSERT_NEAR(besides.values[n], by_grid.values[n], 1e-4f);
}

TEST(ElasticFinite, NoCellIsTurnedInsideOutByALoadThatIsTooMuch) {
  ElasticGrid grid = testing::elastic_block({15, 12, 6}, 1, soft(10, 0.45));
  for (int j = 0; j <= 12; ++j)
    for (int i = 0; i <= 15; ++i) grid.hold(i, j, 0, ElasticGrid::kHeld);
  ElasticSolver solver(grid);
  ElasticField load(grid.layout()), u(grid.layout());
  FiniteSettings settings;
  for (const float force_N : {0.01f, 0.1f, 1.0f, -1.0f}) {
    load.values[grid.layout().node(7, 6, 6, 2)] = -force_N;
    for (int frame = 0; frame < 10; ++frame) {
      const FiniteSolution solution = solver.solve_neo_hookean(load, u, settings);
      EXPECT_GE(solution.min_volume, settings.min_volume);
      ASSERT_TRUE(
          std::all_of(u.values.begin(), u.values.end(), [](float one) { return std::isfinite(one); }));
    }
  }
  // back to rest
  std::fill(load.values.begin(), load.values.end(), 0.0f);
  settings.max_steps = 60;
  settings.tolerance = 1e-6;
  EXPECT_TRUE(solver.solve_neo_hookean(load, u, settings).converged);
  for (const float one : u.values) EXPECT_LE(std::abs(one), 1e-3f);
}

}  // namespace
}  // namespace palpate
