#include "tissue/elastic_kernel.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "palpate/tissue/elastic_solver.h"
#include "sampling/test_targets.h"
#include "tissue/elastic_multigrid.h"
#include "tissue/test_elastic_oracle.h"
#include "tissue/test_elastic_scenes.h"

namespace palpate {
namespace {

using testing::cell_stiffness;
using testing::CellStiffness;
using testing::SlowElastic;

/// Operator of a grid's data, with held nodes.
internal::elastic::Operator operator_of(const ElasticGrid& grid) {
  const ElasticLayout& layout = grid.layout();
  std::vector<std::uint8_t> constraints(layout.node_values() / 3 + ElasticLayout::kSpare,
                                        ElasticGrid::kNoNode);
  SlowElastic(grid).for_each_node(
      [&](int i, int j, int k) { constraints[grid.node_number(i, j, k)] = grid.constraint(i, j, k); });
  return {layout, grid.box().cell_mm, grid.mu(), grid.lambda(), grid.springs(), std::move(constraints)};
}

ElasticField random_field(const ElasticGrid& grid, std::mt19937& random) {
  std::uniform_real_distribution<float> between(-1, 1);
  ElasticField field(grid.layout());
  SlowElastic(grid).for_each_node([&](int i, int j, int k) {
    for (int c = 0; c < 3; ++c) field.values[grid.layout().node(i, j, k, c)] = between(random);
  });
  return field;
}

/// Rows shorter than a vector, equal, and longer; single cells along an axis.
const std::array<int, 3> kShapes[] = {{1, 1, 1},  {2, 1, 3},  {14, 3, 1}, {15, 2, 2},
                                      {16, 1, 2}, {31, 4, 3}, {33, 3, 4}, {7, 6, 5}};

TEST(ElasticKernel, EqualsTheDenseElementOnEverySimdTarget) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  for (const auto& cells : kShapes) {
    SCOPED_TRACE(::testing::PrintToString(cells));
    ElasticGrid grid = testing::random_grid(cells, 0.7, random);
    grid.set_boundary_springs({true, false, true, true, false, true}, Point<Patient>(1, 2, 0.5));
    const ElasticField u = random_field(grid, random);
    const SlowElastic slow(grid);
    const Eigen::VectorXd expected = slow.apply(slow.from(u)), everywhere = slow.apply(slow.from(u), true);
    internal::elastic::Operator k = operator_of(grid);
    ElasticField force(grid.layout()), first(grid.layout());
    for (const std::int64_t target : test::all_targets()) {
      SCOPED_TRACE(test::target_name(target));
      const test::OnlyTargets only(target);
      k.apply(u.values, force.values);
      EXPECT_LE((slow.from(force) - expected).cwiseAbs().maxCoeff(),
                2e-6 * everywhere.cwiseAbs().maxCoeff() + 1e-12);
      if (target == test::all_targets().front()) first = force;
      ASSERT_EQ(std::memcmp(force.values.data(), first.values.data(), force.values.size() * sizeof(float)),
                0);
      k.apply_everywhere(u.values, force.values);
      EXPECT_LE((slow.from(force) - everywhere).cwiseAbs().maxCoeff(),
                2e-6 * everywhere.cwiseAbs().maxCoeff() + 1e-12);
    }
  }
}

TEST(ElasticKernel, DiagonalEqualsTheDenseElement) {
  std::mt19937 random(test::test_seed());
  ElasticGrid grid = testing::random_grid({4, 3, 2}, 1.3, random);
  grid.set_boundary_springs({true, true, true, true, true, true}, Point<Patient>(3, 2, 1));
  internal::elastic::Operator k = operator_of(grid);
  const SlowElastic slow(grid);
  slow.for_each_node([&](int i, int j, int n) {
    for (int c = 0; c < 3; ++c) {
      Eigen::VectorXd unit = Eigen::VectorXd::Zero(slow.values());
      const int value = 3 * slow.number(i, j, n) + c;
      unit[value] = 1;
      const double diagonal = slow.apply(unit)[value];
      const float inverse = k.inverse_diagonal()[grid.layout().node(i, j, n, c)];
      EXPECT_NEAR(inverse * diagonal, diagonal > 0 ? 1 : 0, 1e-5);
    }
  });
}

// the element itself: no force for rigid motion, exact energy for uniform strain, no zero-energy modes
TEST(ElasticKernel, DenseElementHasRigidModesAndExactStrains) {
  const double mu = 3, lambda = 20, h = 0.8;
  const CellStiffness k = cell_stiffness(mu, lambda, h);
  EXPECT_LE((k - k.transpose()).norm(), 1e-12 * k.norm());
  const Eigen::VectorXd values = Eigen::MatrixXd(k).selfadjointView<Eigen::Lower>().eigenvalues();
  EXPECT_LE(values.head<6>().cwiseAbs().maxCoeff(), 1e-12 * values.maxCoeff());
  EXPECT_GE(values[6], 1e-3 * values.maxCoeff());

  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> between(-1, 1);
  Eigen::Matrix3d gradient;
  for (double& one : gradient.reshaped()) one = between(random);
  Eigen::Matrix<double, 24, 1> u;
  for (int corner = 0; corner < 8; ++corner)
    u.segment<3>(3 * corner) = gradient * h * Eigen::Vector3d(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
  const Eigen::Matrix3d strain = (gradient + gradient.transpose()) / 2;
  const double density = mu * strain.squaredNorm() + lambda / 2 * std::pow(strain.trace(), 2);
  EXPECT_NEAR(u.dot(k * u) / 2, density * h * h * h, 1e-12);
}

TEST(ElasticKernel, CoarseCellsRepresentTheSameBody) {
  // a uniform strain has the same energy on the coarse grid, for any moduli
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> unit(0, 1);
  const ElasticGrid grid(
      testing::elastic_box({6, 4, 8}, 0.5),
      [&](const Point<Patient>&) { return testing::soft(5 + 50 * unit(random), 0.3); }, 1);
  internal::elastic::Operator fine = operator_of(grid), coarse = fine.coarser();
  const auto energy = [](internal::elastic::Operator& k, double h) {
    ElasticField u(k.layout()), force(k.layout());
    const auto& cells = k.layout().cells;
    for (int z = 0; z <= cells[2]; ++z)
      for (int y = 0; y <= cells[1]; ++y)
        for (int x = 0; x <= cells[0]; ++x) {
          u.values[k.layout().node(x, y, z, 0)] = static_cast<float>(h * (0.01 * x + 0.02 * z));
          u.values[k.layout().node(x, y, z, 1)] = static_cast<float>(h * (0.03 * y - 0.01 * x));
          u.values[k.layout().node(x, y, z, 2)] = static_cast<float>(h * -0.02 * z);
        }
    k.apply_everywhere(u.values, force.values);
    return internal::elastic::dot(u.values, force.values) / 2;
  };
  EXPECT_NEAR(energy(coarse, 1) / energy(fine, 0.5), 1, 1e-5);
}

}  // namespace
}  // namespace palpate
