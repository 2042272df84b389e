#include "tissue/relaxation_weights.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "base/test_seed.h"
#include "palpate/tissue/elastic_solver.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "tissue/test_soft_block.h"

namespace palpate {
namespace {

using testing::pressed_at;
using testing::soft_block;

constexpr Relaxation kOfBlock{{{{0.4, 2}, {}}}}, kOfBall{{{{0.25, 2}, {0.25, 9}}}};

std::shared_ptr<Model> relaxing_block(const Relaxation& block, const Relaxation& ball) {
  auto model = std::make_shared<Model>(*soft_block(true));
  model->tissues[0].relaxation = block;
  model->tissues[1].relaxation = ball;
  for (const Relaxation& one : {block, ball}) EXPECT_TRUE(model->relaxation_times.add(one));
  return model;
}

LocalCompliance settled(const Model& model, const TickRecord& record) {
  SoftTissueSolver solver;
  for (int n = 0; n < 12; ++n) solver.solve(model, record);
  return solver.frame().local_compliance[0];
}

// u K u equals the sum over the cells
TEST(RelaxationWeights, EnergiesMatchTheSolverStiffness) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> moved(-1, 1);
  const auto model = relaxing_block(kOfBlock, {});
  // one cell per voxel, so that none contains an interface: above the plate, with the ball and part of the
  // block
  ElasticBox box = elastic_box_of(model->labels->geometry(), {{0, 0, 0}, {1, 1, 1}}, 1);
  box.cells = {15, 9, 12};
  box.corner = Point<Patient>(-4.5, -4.5, -15);
  const auto grid = ElasticGrid::of_labels(*model->labels, materials_of(*model), box);
  ASSERT_TRUE(grid.ok());
  const RelaxationWeights fractions(*model, carved_labels(*model), *grid);
  const ElasticLayout& layout = grid->layout();
  ElasticField u(layout), force(layout);
  for (int k = 0; k <= layout.cells[2]; ++k)
    for (int j = 0; j <= layout.cells[1]; ++j)
      for (int i = 0; i <= layout.cells[0]; ++i)
        for (int axis = 0; axis < 3; ++axis) u.values[layout.node(i, j, k, axis)] = moved(random);
  const auto energy = [&](const ElasticGrid& of) {
    ElasticSolver(of).forces(u, force);
    double sum = 0;
    for (std::size_t n = 0; n < u.values.size(); ++n)
      sum += static_cast<double>(u.values[n]) * force.values[n];
    return sum;
  };
  // with the block alone, and with the ball
  std::vector<ElasticMaterial> block_alone = materials_of(*model);
  block_alone[2].matter = Matter::kNone;
  const double all = energy(*grid);
  const double part = fractions.under(*grid, u).relaxed.of_time[0] / kOfBlock.total_fraction();
  const auto without = ElasticGrid::of_labels(*model->labels, block_alone, box);
  ASSERT_TRUE(without.ok());
  const double of_ball = 1 - energy(*without) / all;
  EXPECT_NEAR(1 - part, of_ball, 1e-4);
  EXPECT_GT(of_ball, 0.2);
}

TEST(RelaxationWeights, UniformRelaxationIsIndependentOfTheLoad) {
  const auto model = relaxing_block(kOfBlock, kOfBlock);
  const LocalCompliance local = settled(*model, pressed_at(0, 0));
  EXPECT_NEAR(local.relaxed.of_time[0], 0.4, 1e-9);
  EXPECT_EQ(local.relaxed.of_time[1], 0);
}

// share: relative change of W with the tissue's modulus
TEST(RelaxationWeights, WeightIsTheShareOfStoredEnergy) {
  const auto model = relaxing_block({}, kOfBall);
  const auto fraction_of_ball = [&](double x) {
    return settled(*model, pressed_at(x, 0)).relaxed.of_time[1] / 0.25;
  };
  const auto compliance = [&](double x, double ball_kPa) {
    auto other = std::make_shared<Model>(*model);
    other->tissues[1].elastic->youngs_modulus_kPa = ball_kPa;
    return settled(*other, pressed_at(x, 0)).compliance_mm_per_N;
  };
  // the ball of 100 kPa contributes little, and nothing far from it
  for (const double x : {0.0, 4.0}) {
    const double reported = fraction_of_ball(x);
    const double change = std::log(compliance(x, 90) / compliance(x, 110)) / std::log(110.0 / 90);
    EXPECT_GT(change, 0);
    EXPECT_NEAR(reported, change, 0.35 * change + 0.002) << x;
  }
  EXPECT_LT(fraction_of_ball(25), 0.1 * fraction_of_ball(0));
}

TEST(SoftTissueSolver, PublishesNoRelaxationWithoutRelaxingTissue) {
  const auto model = soft_block(true);
  EXPECT_FALSE(settled(*model, pressed_at(0, 0)).relaxed.any());
  // W is the same either way
  const auto relaxing = relaxing_block(kOfBlock, kOfBall);
  EXPECT_EQ(settled(*relaxing, pressed_at(0, 0)).compliance_mm_per_N,
            settled(*model, pressed_at(0, 0)).compliance_mm_per_N);
}

TEST(SoftTissueSolver, UpdatesWhenTheRelaxationChanges) {
  SoftTissueSolver solver;
  solver.solve(*relaxing_block(kOfBlock, kOfBlock), pressed_at(0, 0));
  auto other = std::make_shared<Model>(*relaxing_block(kOfBlock, kOfBlock));
  other->tissues[0].relaxation.term[0].fraction = other->tissues[1].relaxation.term[0].fraction = 0.1;
  EXPECT_NEAR(solver.solve(*other, pressed_at(0, 0)).local_compliance[0].relaxed.of_time[0], 0.1, 1e-9);
}

}  // namespace
}  // namespace palpate
