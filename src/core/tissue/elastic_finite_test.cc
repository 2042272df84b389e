#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
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
/// @param b  ElasticConstants::stiffening
double cell_energy(double mu, double lambda, double b, double h, const Eigen::Matrix<double, 24, 1>& u) {
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
  const double neo_hookean = density * h * h * h + u.dot((all - even) * u) / 2;
  if (b == 0) return neo_hookean;
  const double unit = mu * h * h * h / (2 * b);
  return unit * std::expm1(neo_hookean / unit);
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
        energy += cell_energy(grid.mu()[cell], grid.lambda()[cell], grid.stiffening()[cell],
                              grid.box().cell_mm, local);
      }
  return energy;
}

ElasticField random_displacement(const ElasticGrid& grid, float largest, std::mt19937& random) {
  std::uniform_real_distribution<float> between(-largest, largest);
  ElasticField field(grid.layout());
  SlowElastic(grid).for_each_node([&](int i, int j, int k) {
    for (int c = 0; c < 3; ++c) field.values[grid.layout().node(i, j, k, c)] = between(random);
  });
  return field;
}

class ElasticFiniteStrain : public ::testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Stiffening, ElasticFiniteStrain, ::testing::Values(0.0, 12.0));

TEST_P(ElasticFiniteStrain, ForcesAreTheEnergyGradient) {
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> unit(0, 1);
  const ElasticGrid grid(
      testing::elastic_box({3, 2, 2}, 0.8),
      [&](const Point<Patient>&) { return soft(5 + 50 * unit(random), 0.4, GetParam() * unit(random)); }, 1);
  const ElasticField u = random_displacement(grid, 0.15f, random);
  ElasticSolver solver(grid);
  ElasticField force(grid.layout());
  solver.neo_hookean_forces(u, force);
  const SlowElastic slow(grid);
  const Eigen::VectorXd at = slow.from(u), reported = slow.from(force);
  for (int n = 0; n < slow.values(); ++n) {
    const Eigen::VectorXd step = 1e-5 * Eigen::VectorXd::Unit(slow.values(), n);
    EXPECT_NEAR((energy_of(grid, at + step) - energy_of(grid, at - step)) / 2e-5, reported[n],
                1e-5 * reported.cwiseAbs().maxCoeff());
  }
}

TEST_P(ElasticFiniteStrain, TangentIsTheForceDerivativeOnEverySimdTarget) {
  std::mt19937 random(test::test_seed());
  ElasticGrid grid = testing::random_grid({18, 3, 3}, 0.7, random);
  std::uniform_real_distribution<float> exponent(0, static_cast<float>(GetParam()));
  ElasticValues stiffening;
  if (GetParam() > 0)
    for (const float mu : grid.mu()) stiffening.push_back(mu > 0 ? exponent(random) : 0);
  internal::elastic::Multigrid multigrid([&] {
    std::vector<std::uint8_t> free(grid.layout().node_values() / 3 + ElasticLayout::kSpare, 0);
    return internal::elastic::Operator(grid.layout(), 0.7, grid.mu(), grid.lambda(), grid.springs(), free,
                                       stiffening);
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
    k.apply_finite_strain(high.values, at_high.values);
    k.apply_finite_strain(low.values, at_low.values);
    k.apply_tangent(u.values, path.values, reported.values);
    double largest = 0, off = 0;
    for (std::size_t n = 0; n < u.values.size(); ++n) {
      const double slope = (static_cast<double>(at_high.values[n]) - at_low.values[n]) / (2 * kStep);
      largest = std::max(largest, std::abs(slope));
      off = std::max(off, std::abs(slope - reported.values[n]));
    }
    EXPECT_LE(off, 2e-3 * largest);
    if (first.values.empty()) first = reported;
    ASSERT_EQ(
        std::memcmp(reported.values.data(), first.values.data(), reported.values.size() * sizeof(float)), 0);
  }
}

TEST(ElasticFinite, ZeroStiffeningIsBitIdenticalToNeoHookean) {
  std::mt19937 random(test::test_seed());
  const ElasticGrid grid = testing::random_grid({18, 3, 3}, 0.7, random);
  std::vector<std::uint8_t> free(grid.layout().node_values() / 3 + ElasticLayout::kSpare, 0);
  ElasticValues almost_none(grid.mu().size(), 0.0f);
  // selects the exponential law, in a cell that is empty
  almost_none.back() = 1;
  internal::elastic::Operator neo_hookean(grid.layout(), 0.7, grid.mu(), grid.lambda(), grid.springs(), free),
      exponential = neo_hookean;
  exponential.change(grid.mu(), grid.lambda(), grid.springs(), free, grid.all_cells(), almost_none);
  const ElasticField u = random_displacement(grid, 0.1f, random), path = random_displacement(grid, 1, random);
  ElasticField a(grid.layout()), b(grid.layout());
  neo_hookean.apply_finite_strain(u.values, a.values);
  exponential.apply_finite_strain(u.values, b.values);
  EXPECT_EQ(a.values, b.values);
  neo_hookean.apply_tangent(u.values, path.values, a.values);
  exponential.apply_tangent(u.values, path.values, b.values);
  EXPECT_EQ(a.values, b.values);
}

/// Uniform block with all nodes on its surface held at u = A x, solved inside.
ElasticField solved_inside(const ElasticGrid& grid, const Eigen::Matrix3d& a, int steps) {
  ElasticGrid constrained_grid = grid;
  const auto& cells = grid.layout().cells;
  const double h = grid.box().cell_mm;
  ElasticField u(grid.layout()), load(grid.layout()), linear(grid.layout());
  const auto for_each_constrained = [&](const auto& visit) {
    for (int k = 0; k <= cells[2]; ++k)
      for (int j = 0; j <= cells[1]; ++j)
        for (int i = 0; i <= cells[0]; ++i)
          if (i == 0 || j == 0 || k == 0 || i == cells[0] || j == cells[1] || k == cells[2]) visit(i, j, k);
  };
  for_each_constrained(
      [&](int i, int j, int k) { constrained_grid.constrain(i, j, k, ElasticGrid::kFixed); });
  ElasticSolver solver(constrained_grid);
  NeoHookeanSettings settings;
  settings.max_steps = 40;
  settings.max_iterations = 40;
  settings.tolerance = 1e-6;
  for (int step = 1; step <= steps; ++step) {
    // the linear response to the change of the held displacements first
    std::fill(linear.values.begin(), linear.values.end(), 0.0f);
    for_each_constrained([&](int i, int j, int k) {
      const Eigen::Vector3d moved = a * (h / steps * Eigen::Vector3d(i, j, k));
      for (int c = 0; c < 3; ++c)
        linear.values[grid.layout().node(i, j, k, c)] = static_cast<float>(moved[c]);
    });
    solver.solve(load, linear, 40, 1e-5);
    for (std::size_t n = 0; n < u.values.size(); ++n) u.values[n] += linear.values[n];
    solver.solve_neo_hookean(load, u, settings);
  }
  return u;
}

TEST(ElasticFinite, StiffeningBodyPassesThePatchTest) {
  constexpr double kE_kPa = 10, kNu = 0.4, kExponent = 15, kCell_mm = 0.9;
  const ElasticGrid grid = testing::elastic_block({6, 5, 4}, kCell_mm, soft(kE_kPa, kNu, kExponent));
  Eigen::Matrix3d a;
  a << 0.05, 0.08, 0, -0.03, 0.04, 0.02, 0, 0.06, -0.12;
  const ElasticField u = solved_inside(grid, a, 1);
  const SlowElastic slow(grid);
  double largest = 0;
  slow.for_each_node([&](int i, int j, int k) {
    const Eigen::Vector3d there = a * (kCell_mm * Eigen::Vector3d(i, j, k));
    for (int c = 0; c < 3; ++c)
      largest = std::max(largest, std::abs(u.values[grid.layout().node(i, j, k, c)] - there[c]));
  });
  EXPECT_LE(largest, 2e-5);

  // force on the top face: first Piola-Kirchhoff stress P = exp(x) (mu F + s cof F), times its area
  ElasticField force(grid.layout());
  ElasticSolver(grid).neo_hookean_forces(u, force);
  Eigen::Vector3d top = Eigen::Vector3d::Zero();
  for (int j = 0; j <= 5; ++j)
    for (int i = 0; i <= 6; ++i)
      for (int c = 0; c < 3; ++c) top[c] += force.values[grid.layout().node(i, j, 4, c)];
  const double mu = 1e-3 * kE_kPa / (2 * (1 + kNu)), lambda = 2 * mu * kNu / (1 - 2 * kNu);
  const Eigen::Matrix3d f = Eigen::Matrix3d::Identity() + a,
                        cofactor = f.determinant() * f.inverse().transpose();
  const double change = f.determinant() - 1;
  const double energy = mu / 2 * (f.squaredNorm() - 3) - mu * change + (lambda + mu) / 2 * change * change;
  const Eigen::Matrix3d stress =
      std::exp(2 * kExponent * energy / mu) * (mu * f + ((lambda + mu) * change - mu) * cofactor);
  const Eigen::Vector3d expected = stress.col(2) * (6 * 5 * kCell_mm * kCell_mm);
  EXPECT_LE((top - expected).norm(), 1e-4 * expected.norm());
}

TEST(ElasticFinite, ClosedPathOfAStiffeningBodyDoesNoWork) {
  std::mt19937 random(test::test_seed());
  const ElasticGrid grid = testing::elastic_block({4, 4, 3}, 1, soft(10, 0.45, 10));
  ElasticSolver solver(grid);
  const ElasticField first = random_displacement(grid, 0.08f, random),
                     second = random_displacement(grid, 0.08f, random);
  const SlowElastic slow(grid);
  const Eigen::VectorXd a = slow.from(first), b = slow.from(second);
  ElasticField u(grid.layout()), force(grid.layout());
  // a circle in the plane of both displacements, from rest to rest
  constexpr int kSteps = 400;
  double work = 0, gross = 0;
  Eigen::VectorXd before_u = Eigen::VectorXd::Zero(slow.values()), before_f = before_u;
  for (int n = 0; n <= kSteps; ++n) {
    const double angle = 2 * std::numbers::pi * n / kSteps;
    const auto x = static_cast<float>(1 - std::cos(angle)), y = static_cast<float>(std::sin(angle));
    for (std::size_t m = 0; m < u.values.size(); ++m)
      u.values[m] = 0.5f * x * first.values[m] + y * second.values[m];
    solver.neo_hookean_forces(u, force);
    const Eigen::VectorXd now_u = 0.5 * x * a + y * b, now_f = slow.from(force);
    if (n > 0) {
      const double step = 0.5 * (now_f + before_f).dot(now_u - before_u);
      work += step;
      gross += std::abs(step);
    }
    before_u = now_u;
    before_f = now_f;
  }
  EXPECT_LE(std::abs(work), 2e-4 * gross);
}

TEST(ElasticFinite, LargeRotationCausesNoForce) {
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
    solver.neo_hookean_forces(u, force);
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
  solver.neo_hookean_forces(u, finite);
  const SlowElastic slow(grid);
  EXPECT_LE((slow.from(linear) - slow.from(finite)).cwiseAbs().maxCoeff(),
            5e-3 * slow.from(linear).cwiseAbs().maxCoeff());
}

TEST(ElasticFinite, ConstrainedMeansEqualGridConstraints) {
  ElasticGrid grid = testing::elastic_block({15, 12, 6}, 1, soft(10, 0.45));
  for (int j = 0; j <= 12; ++j)
    for (int i = 0; i <= 15; ++i) grid.constrain(i, j, 0, ElasticGrid::kFixed);
  const ElasticLayout& layout = grid.layout();
  ElasticSolver solver(grid);
  ElasticField load(layout), besides(layout);
  ConstrainedMeans constraints;
  for (int j = 5; j <= 7; ++j)
    for (int i = 6; i <= 8; ++i) {
      grid.constrain(i, j, 6, ElasticGrid::kFixed);
      for (int c = 0; c < 3; ++c) {
        const ConstrainedMeans::Weight one{static_cast<std::uint32_t>(layout.node(i, j, 6, c)), 2};
        constraints.add({&one, 1});
      }
      besides.values[layout.node(i, j, 6, 2)] = -0.5f;
    }
  ElasticField by_grid = besides;
  NeoHookeanSettings settings;
  settings.max_steps = 40;
  settings.max_iterations = 60;
  settings.tolerance = 2e-5;  // about the precision of floats
  EXPECT_TRUE(solver.solve_neo_hookean(load, besides, settings, constraints).converged);
  EXPECT_TRUE(ElasticSolver(grid).solve_neo_hookean(load, by_grid, settings).converged);
  for (std::size_t n = 0; n < by_grid.values.size(); ++n)
    ASSERT_NEAR(besides.values[n], by_grid.values[n], 1e-4f);
}

TEST(ElasticFinite, ExcessiveLoadInvertsNoCell) {
  ElasticGrid grid = testing::elastic_block({15, 12, 6}, 1, soft(10, 0.45));
  for (int j = 0; j <= 12; ++j)
    for (int i = 0; i <= 15; ++i) grid.constrain(i, j, 0, ElasticGrid::kFixed);
  ElasticSolver solver(grid);
  ElasticField load(grid.layout()), u(grid.layout());
  NeoHookeanSettings settings;
  for (const float force_N : {0.01f, 0.1f, 1.0f, -1.0f}) {
    load.values[grid.layout().node(7, 6, 6, 2)] = -force_N;
    for (int frame = 0; frame < 10; ++frame) {
      const NeoHookeanSolution solution = solver.solve_neo_hookean(load, u, settings);
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
