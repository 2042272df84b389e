#include "palpate/tissue/elastic_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "sampling/test_targets.h"
#include "tissue/test_elastic_oracle.h"
#include "tissue/test_elastic_scenes.h"

// Comparison with dense solutions and physical properties; the analytic cases are in
// src/studies/verification/tissue_cases_test.cc.

namespace palpate {
namespace {

using testing::SlowElastic;
using testing::soft;

constexpr int kMany = 300;

void press_down(const ElasticGrid& grid, int i, int j, float force_N, ElasticField& load) {
  load.values[grid.layout().node(i, j, grid.layout().cells[2], 2)] -= force_N;
}

ElasticGrid on_bone(std::array<int, 3> cells, const ElasticGrid::MaterialAt& material) {
  ElasticGrid grid(testing::elastic_box(cells), material, 2);
  for (int j = 0; j <= cells[1]; ++j)
    for (int i = 0; i <= cells[0]; ++i) grid.constrain(i, j, 0, ElasticGrid::kFixed);
  return grid;
}

// Sum over the cells of each face, by the formula of set_boundary_springs().
TEST(ElasticGrid, BoundarySpringsFollowTheirFormulaOnEveryFace) {
  constexpr std::array<int, 3> kCells{4, 3, 5};
  constexpr double kCell_mm = 1.3, kModulus_kPa = 20, kPoisson = 0.4;
  const Point<Patient> about(2.1, 1.7, 3.2);
  for (int face = 0; face < 6; ++face) {
    SCOPED_TRACE(face);
    ElasticGrid grid = testing::elastic_block(kCells, kCell_mm, soft(kModulus_kPa, kPoisson));
    std::array<bool, 6> faces{};
    faces[static_cast<std::size_t>(face)] = true;
    grid.set_boundary_springs(faces, about);
    const int axis = face / 2, level = face % 2 == 0 ? 0 : kCells[static_cast<std::size_t>(axis)];
    const double mu_N_per_mm2 = 1e-3 * kModulus_kPa / (2 * (1 + kPoisson));
    double sum_N_per_mm = 0;
    for (int k = 0; k <= kCells[2]; ++k)
      for (int j = 0; j <= kCells[1]; ++j)
        for (int i = 0; i <= kCells[0]; ++i) {
          const std::array<int, 3> node{i, j, k};
          // quarter of a cell's face for each cell that has the node as a corner
          double area_mm2 = node[static_cast<std::size_t>(axis)] == level ? kCell_mm * kCell_mm : 0;
          for (int other = 0; other < 3; ++other) {
            const auto o = static_cast<std::size_t>(other);
            if (other != axis && (node[o] == 0 || node[o] == kCells[o])) area_mm2 /= 2;
          }
          const Eigen::Vector3d from_load_mm = Eigen::Vector3d(i, j, k) * kCell_mm - about.eigen();
          const double r = std::max(from_load_mm.norm(), kCell_mm);
          const double along =
              3 / (3 - 2 * kPoisson) * mu_N_per_mm2 * area_mm2 * std::abs(from_load_mm[axis]) / (r * r);
          for (int c = 0; c < 3; ++c) {
            const double found = grid.springs()[grid.layout().node(i, j, k, c)];
            EXPECT_NEAR(found, c == axis ? 2 * along : along, 1e-6) << i << ' ' << j << ' ' << k;
            sum_N_per_mm += found;
          }
        }
    EXPECT_GT(sum_N_per_mm, 0.01);
  }
}

TEST(ElasticSolver, EqualsTheDenseSolution) {
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> unit(0, 1);
  ElasticGrid grid =
      on_bone({6, 4, 5}, [&](const Point<Patient>&) { return soft(5 + 50 * unit(random), 0.4); });
  grid.set_boundary_springs({true, false, false, true, false, false}, Point<Patient>(3, 2, 5));
  const SlowElastic slow(grid);
  ElasticField load(grid.layout()), u(grid.layout());
  Eigen::VectorXd right = Eigen::VectorXd::Zero(slow.values());
  slow.for_each_node([&](int i, int j, int k) {
    if (k == 0) return;
    for (int c = 0; c < 3; ++c)
      right[3 * slow.number(i, j, k) + c] = load.values[grid.layout().node(i, j, k, c)] =
          static_cast<float>(0.01 * unit(random));
  });
  // columns of the dense K, identity where nodes are held
  Eigen::MatrixXd dense(slow.values(), slow.values());
  for (int n = 0; n < slow.values(); ++n) {
    dense.col(n) = slow.apply(Eigen::VectorXd::Unit(slow.values(), n));
    if (n < 3 * slow.number(0, 0, 1)) dense.col(n) = Eigen::VectorXd::Unit(slow.values(), n);
  }
  const Eigen::VectorXd expected = dense.partialPivLu().solve(right);
  ElasticSolver solver(grid);
  const ElasticSolution solution = solver.solve(load, u, kMany, 1e-6);
  EXPECT_TRUE(solution.converged);
  EXPECT_LE((slow.from(u) - expected).cwiseAbs().maxCoeff(), 1e-4 * expected.cwiseAbs().maxCoeff());
}

TEST(ElasticSolver, IterationCountIsIndependentOfTheGridSize) {
  // homogeneous, and with a nodule 10 times as stiff
  for (const double stiff : {10.0, 100.0}) {
    for (const int n : {12, 24, 40}) {
      const Point<Patient> nodule(n / 2.0, n / 2.0, 4.5);
      const ElasticGrid grid = on_bone({n - 1, n, 9}, [&](const Point<Patient>& p) {
        return soft((p - nodule).norm() < 3 ? stiff : 10, 0.45);
      });
      ElasticSolver solver(grid);
      ElasticField load(grid.layout()), u(grid.layout());
      press_down(grid, n / 2, n / 2, 0.01f, load);
      const ElasticSolution solution = solver.solve(load, u, kMany, 1e-3);
      EXPECT_TRUE(solution.converged);
      EXPECT_LE(solution.iterations, stiff > 10 ? 16 : 10) << n;
    }
  }
}

TEST(ElasticSolver, StepsGiveTheSameBitsAsWholeCalls) {
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<float> force(-0.01f, 0.01f);
  const ElasticGrid grid = testing::random_grid({14, 13, 9}, 0.7, random);
  ElasticField load(grid.layout()), whole(grid.layout()), stepped(grid.layout());
  for (float& value : load.values) value = force(random);
  ElasticSolver solver(grid), other = ElasticSolver::unprepared(grid);
  const ElasticSolution solution = solver.solve(load, whole, 7, 1e-9);
  int preparations = 1, iterations = 1;
  while (!other.prepare()) ++preparations;
  EXPECT_TRUE(other.prepare()) << "it is complete";
  other.begin_solve(load, stepped, 7, 1e-9);
  while (!other.iterate(stepped)) ++iterations;
  EXPECT_TRUE(other.iterate(stepped)) << "it has ended";
  EXPECT_GE(preparations, 5);
  EXPECT_EQ(iterations, 7);
  EXPECT_EQ(other.solution().iterations, solution.iterations);
  EXPECT_EQ(other.solution().residual, solution.residual);
  EXPECT_EQ(other.solution().converged, solution.converged);
  ASSERT_EQ(stepped.values.size(), whole.values.size());
  EXPECT_EQ(std::memcmp(stepped.values.data(), whole.values.data(), 4 * whole.values.size()), 0);
}

TEST(ElasticSolver, WarmStartsFromTheLastSolution) {
  const ElasticGrid grid = on_bone({15, 15, 8}, [](const Point<Patient>&) { return soft(10, 0.45); });
  ElasticSolver solver(grid);
  ElasticField load(grid.layout()), u(grid.layout());
  EXPECT_EQ(solver.solve(load, u, kMany, 1e-4).iterations, 0);
  press_down(grid, 7, 7, 0.01f, load);
  EXPECT_GT(solver.solve(load, u, kMany, 1e-4).iterations, 0);
  EXPECT_EQ(solver.solve(load, u, kMany, 1.1e-4).iterations, 0);
  // back to rest
  std::fill(load.values.begin(), load.values.end(), 0.0f);
  const float pressed = u.values[grid.layout().node(7, 7, 8, 2)];
  solver.solve(load, u, 30, 0);
  EXPECT_LE(std::abs(u.values[grid.layout().node(7, 7, 8, 2)]), 1e-5f * std::abs(pressed));
}

TEST(ElasticSolver, StopsAtTheIterationLimit) {
  const ElasticGrid grid = on_bone({15, 15, 8}, [](const Point<Patient>&) { return soft(10, 0.49); });
  ElasticSolver solver(grid);
  ElasticField load(grid.layout()), u(grid.layout());
  press_down(grid, 7, 7, 0.01f, load);
  const ElasticSolution solution = solver.solve(load, u, 2, 1e-9);
  EXPECT_EQ(solution.iterations, 2);
  EXPECT_FALSE(solution.converged);
  EXPECT_GT(solution.residual, 1e-9);
}

TEST(ElasticSolver, SolutionIsBitIdenticalOnEverySimdTarget) {
  const ElasticGrid grid =
      on_bone({17, 9, 6}, [](const Point<Patient>& p) { return soft(p.x() < 8 ? 5 : 50, 0.4); });
  ElasticField load(grid.layout()), first;
  press_down(grid, 9, 4, 0.01f, load);
  for (const std::int64_t target : test::all_targets()) {
    SCOPED_TRACE(test::target_name(target));
    const test::OnlyTargets only(target);
    ElasticSolver solver(grid);
    ElasticField u(grid.layout());
    solver.solve(load, u, 5, 0);
    if (first.values.empty()) first = u;
    ASSERT_EQ(std::memcmp(u.values.data(), first.values.data(), u.values.size() * sizeof(float)), 0);
  }
}

TEST(ElasticSolver, ForcesAreInBalanceAndWorkIsEnergy) {
  const ElasticGrid grid = on_bone({11, 9, 6}, [](const Point<Patient>&) { return soft(10, 0.45); });
  ElasticSolver solver(grid);
  ElasticField load(grid.layout()), u(grid.layout()), force(grid.layout());
  press_down(grid, 5, 4, 0.01f, load);
  load.values[grid.layout().node(3, 4, 6, 0)] = 0.004f;
  solver.solve(load, u, kMany, 1e-6);
  solver.forces(u, force);
  // reaction forces balance the load
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double work = 0, energy = 0;
  SlowElastic(grid).for_each_node([&](int i, int j, int k) {
    for (int c = 0; c < 3; ++c) {
      const std::size_t n = grid.layout().node(i, j, k, c);
      sum[c] += force.values[n];
      work += 0.5 * static_cast<double>(load.values[n]) * u.values[n];
      energy += 0.5 * static_cast<double>(force.values[n]) * u.values[n];
    }
  });
  EXPECT_LE(sum.norm(), 1e-6);
  EXPECT_NEAR(energy / work, 1, 1e-5);
}

TEST(ElasticSolver, RandomScenesStayFiniteAndReturnToRest) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  std::uniform_real_distribution<float> push(-0.05f, 0.05f);
  int converged = 0;
  constexpr int kScenes = 100;
  for (int scene = 0; scene < kScenes; ++scene) {
    const std::array<int, 3> cells{3 + static_cast<int>(random() % 20), 3 + static_cast<int>(random() % 8),
                                   3 + static_cast<int>(random() % 8)};
    ElasticGrid grid = testing::random_grid(cells, 0.5, random);
    if (random() % 2 == 0)
      grid.set_boundary_springs({true, true, false, true, true, false}, grid.box().patient({2, 2, 2}));
    ElasticSolver solver(grid);
    ElasticField load(grid.layout()), u(grid.layout());
    for (int n = 0; n < 4; ++n) {
      const int i = static_cast<int>(random() % static_cast<unsigned>(cells[0] + 1)),
                j = static_cast<int>(random() % static_cast<unsigned>(cells[1] + 1)),
                k = static_cast<int>(random() % static_cast<unsigned>(cells[2] + 1));
      for (int c = 0; c < 3; ++c) load.values[grid.layout().node(i, j, k, c)] = push(random);
      const ElasticSolution solution = solver.solve(load, u, 60, 1e-3);
      converged += solution.converged;
      ASSERT_TRUE(std::isfinite(solution.residual));
      ASSERT_TRUE(
          std::all_of(u.values.begin(), u.values.end(), [](float one) { return std::isfinite(one); }));
    }
    const auto greatest = [&] {
      float largest = 0;
      for (const float one : u.values) largest = std::max(largest, std::abs(one));
      return largest;
    };
    const float pressed = greatest();
    std::fill(load.values.begin(), load.values.end(), 0.0f);
    solver.solve(load, u, 200, 0);
    EXPECT_LE(greatest(), 0.01f * pressed + 1e-6f) << scene;
  }
  RecordProperty("converged", converged);
}

TEST(ElasticGrid, FloatingPartsAreConstrained) {
  // a block in the air next to one on bone
  ElasticGrid grid = on_bone({12, 4, 4}, [](const Point<Patient>& p) {
    return p.x() < 5 || (p.x() > 7 && p.z() > 1) ? soft(10, 0.4) : ElasticMaterial{};
  });
  EXPECT_EQ(grid.constrain_floating_components(), static_cast<std::size_t>(5 * 4 * 3));
  EXPECT_EQ(grid.constraint(12, 4, 4) & ElasticGrid::kFixed, ElasticGrid::kFixed);
  EXPECT_EQ(grid.constraint(2, 2, 2) & ElasticGrid::kFixed, 0);
  EXPECT_EQ(grid.constraint(6, 2, 3) & ElasticGrid::kNoNode, ElasticGrid::kNoNode);
}

TEST(ElasticGrid, WeightsLabelsByTheirShareOfACell) {
  // bone below, then two tissues with an interface in the middle of a cell; oblique and left-handed axes
  GridGeometry geometry = test::make_grid({8, 8, 12}, 3);
  geometry.spacing_mm = {0.5, 0.5, 0.5};
  Volume<LabelId> labels(geometry);
  for (int k = 0; k < 12; ++k)
    for (int j = 0; j < 8; ++j)
      for (int i = 0; i < 8; ++i)
        labels.at(i, j, k) = static_cast<LabelId>(k < 2 ? 3 : k < 5 ? 1 : k < 9 ? 2 : 0);
  const ElasticMaterial by_label[] = {{}, soft(10, 0.3), soft(40, 0.3), {Matter::kRigid, 0, 0}};
  const auto grid = ElasticGrid::of_labels(*label_bricks(labels), by_label,
                                           elastic_box_of(labels.geometry(), {{0, 0, 0}, {8, 8, 12}}, 1));
  ASSERT_TRUE(grid.ok());
  EXPECT_EQ(grid->layout().cells, (std::array<int, 3>{4, 4, 6}));
  const auto youngs_kPa = [&](int k) {
    const std::size_t cell = grid->layout().cell(1, 2, k);
    const double mu = grid->mu()[cell], lambda = grid->lambda()[cell];
    return 1000 * mu * (3 * lambda + 2 * mu) / (lambda + mu);
  };
  EXPECT_EQ(grid->constraint(1, 2, 1) & ElasticGrid::kFixed, ElasticGrid::kFixed);
  EXPECT_EQ(grid->constraint(1, 2, 2) & ElasticGrid::kFixed, 0);
  EXPECT_NEAR(youngs_kPa(1), 10, 1e-3);
  EXPECT_NEAR(youngs_kPa(2), 2 / (1 / 10.0 + 1 / 40.0), 1e-3);
  EXPECT_NEAR(youngs_kPa(3), 40, 1e-3);
  // half air
  EXPECT_NEAR(youngs_kPa(4), 20, 1e-3);
  EXPECT_NEAR(grid->fill()[grid->layout().cell(1, 2, 4)], 0.5, 1e-6);
  EXPECT_EQ(grid->mu()[grid->layout().cell(1, 2, 5)], 0);
  // position in the patient
  const Point<Patient> corner = geometry.X_PatientVoxel() * Point<Voxel>(7.5, 7.5, 11.5);
  EXPECT_LE((grid->box().patient({4, 4, 6}) - corner).norm(), 1e-9);
}

TEST(ElasticGrid, RejectsInvalidMaterials) {
  const auto labels = label_bricks(Volume<LabelId>(test::make_grid({4, 4, 4}, 0)));
  const VoxelBox all{{0, 0, 0}, {4, 4, 4}};
  const auto refused = [&](const ElasticMaterial& material, const VoxelBox& region, double cell_mm) {
    return !ElasticGrid::of_labels(*labels, {&material, 1},
                                   elastic_box_of(labels->geometry(), region, cell_mm))
                .ok();
  };
  EXPECT_FALSE(refused(soft(10, 0.45), all, 1));
  EXPECT_TRUE(refused(soft(10, 0.5), all, 1));
  EXPECT_TRUE(refused(soft(0.01, 0.3), all, 1));
  EXPECT_TRUE(refused(soft(std::nan(""), 0.3), all, 1));
  EXPECT_TRUE(refused(soft(10, 0.45), {{0, 0, 0}, {4, 0, 4}}, 1));
  EXPECT_TRUE(refused(soft(10, 0.45), all, 0));
  EXPECT_TRUE(refused(soft(10, 0.45), all, std::nan("")));
}

}  // namespace
}  // namespace palpate
