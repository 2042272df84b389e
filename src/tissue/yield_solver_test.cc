#include "palpate/tissue/yield_solver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "tissue/test_soft_block.h"

namespace palpate {
namespace {

using testing::pressed_at;
using testing::soft_block;
using testing::tool_at;

double settled_compliance(const Model& model, const TickRecord& felt) {
  YieldSolver solver;
  for (int n = 0; n < 12; ++n) solver.solve(model, felt);
  return solver.frame().spot[0].compliance_mm_per_N;
}

TEST(YieldSolver, KnowsWhatIsUnderAToolThatComes) {
  const auto model = soft_block(false);
  YieldSolver solver;
  const YieldFrame& frame = solver.solve(*model, tool_at({2, 1, 6}));
  EXPECT_EQ(frame.number, 1u);
  const YieldSpot& spot = frame.spot[0];
  ASSERT_TRUE(spot.is_known());
  EXPECT_LT((spot.at - Point<Patient>(2, 1, 0)).norm(), 0.01);
  EXPECT_EQ(spot.patch_radius_mm, 3);
  EXPECT_NEAR(spot.modulus_N_per_mm2, 0.0125, 0.0125 * 0.05);
  // a layer of 20 mm on a plate gives less than a half space, and not by much under so small a patch
  const double half_space = 0.6 / (3 * 0.01 / (1 - 0.45 * 0.45));
  EXPECT_LT(spot.compliance_mm_per_N, half_space);
  EXPECT_GT(spot.compliance_mm_per_N, 0.8 * half_space);
  EXPECT_FALSE(frame.spot[1].is_known());
}

TEST(YieldSolver, GivesOnOneFrameAfterAnotherWhatItWouldGiveInTheEnd) {
  const auto model = soft_block(true);
  const TickRecord still = pressed_at(0, 0);
  YieldSolver solver;
  const double first = solver.solve(*model, still).spot[0].compliance_mm_per_N;
  const double end = settled_compliance(*model, still);
  EXPECT_NEAR(first / end, 1, 0.01);
  solver.solve(*model, still);
  EXPECT_NEAR(solver.frame().spot[0].compliance_mm_per_N / end, 1, 2e-3);
}

TEST(YieldSolver, IsHarderOverSomethingHardAndSlopesTowardsIt) {
  const auto model = soft_block(true);
  const double over = settled_compliance(*model, pressed_at(0, 0)),
               beside = settled_compliance(*model, pressed_at(20, 0));
  EXPECT_LT(over, 0.92 * beside);
  YieldSolver solver;
  for (int n = 0; n < 8; ++n) solver.solve(*model, pressed_at(4, 0));
  const YieldSpot& spot = solver.frame().spot[0];
  EXPECT_GT(spot.slope_per_N.x(), 0);
  // within a cell: from cell to cell W has ripples of a thousandth
  const double change =
      (settled_compliance(*model, pressed_at(4.1, 0)) - settled_compliance(*model, pressed_at(3.9, 0))) / 0.2;
  EXPECT_NEAR(spot.slope_per_N.x() / change, 1, 0.15);
}

TEST(YieldSolver, FollowsAToolThroughBoxesThatAreLaidAnew) {
  const auto model = soft_block(true);
  constexpr double kSpeed_mm_s = 50;
  YieldSolver solver;
  double worst = 0;
  // 16 mm of box lie on each side: three are laid on the way
  for (double x = -22; x < 22; x += kSpeed_mm_s * kYieldFrame_s) {
    const YieldSpot& spot = solver.solve(*model, pressed_at(x, 0.3, kSpeed_mm_s)).spot[0];
    ASSERT_TRUE(spot.is_known());
    // for where the tool will be
    EXPECT_NEAR(spot.at.x(), x + 1.5 * kSpeed_mm_s * kYieldFrame_s, 1e-6);
    if (static_cast<int>(std::floor(x)) % 4 != 0) continue;
    const double end = settled_compliance(*model, pressed_at(spot.at.x(), 0.3));
    worst = std::max(worst, std::abs(spot.compliance_mm_per_N / end - 1));
  }
  EXPECT_LT(worst, 0.025);
}

TEST(YieldSolver, DependsOnNothingButWhatItWasGiven) {
  const auto model = soft_block(true);
  YieldSolver one, other;
  for (int n = 0; n < 20; ++n) {
    const TickRecord felt = pressed_at(-15 + 1.5 * n, 0.1 * n, 90);
    EXPECT_EQ(one.solve(*model, felt).hash(), other.solve(*model, felt).hash());
  }
}

TEST(YieldSolver, KnowsNothingWhereNothingSoftIsNear) {
  const auto model = soft_block(false);
  YieldSolver solver;
  EXPECT_FALSE(solver.solve(*model, tool_at({0, 0, 30})).spot[0].is_known());
  EXPECT_FALSE(solver.solve(*model, tool_at({0, std::nan(""), 1})).spot[0].is_known());
  EXPECT_FALSE(solver.solve(*model, tool_at({0, 0, 1}, {0, std::nan(""), 0})).spot[0].is_known());
  EXPECT_EQ(solver.frame().number, 3u);
  auto bare = std::make_shared<Model>(*model);
  bare->tissues[0].elastic.reset();
  EXPECT_FALSE(solver.solve(*bare, tool_at({0, 0, 1})).spot[0].is_known());
  YieldField field;
  EXPECT_FALSE(solver.field_of(0, field));
  // and is none the worse for it
  bare->version = 2;
  bare->tissues[0].elastic = ElasticConstants{10, 0.45};
  EXPECT_TRUE(solver.solve(*bare, tool_at({0, 0, 1})).spot[0].is_known());
  EXPECT_TRUE(solver.field_of(0, field));
}

TEST(YieldSolver, EveryDeviceHasItsOwnPlace) {
  const auto model = soft_block(true);
  TickRecord felt = pressed_at(0, 0);
  felt.devices = 2;
  felt.device[1] = pressed_at(20, 0).device[0];
  YieldSolver solver;
  for (int n = 0; n < 6; ++n) solver.solve(*model, felt);
  const auto& spot = solver.frame().spot;
  ASSERT_TRUE(spot[0].is_known() && spot[1].is_known());
  EXPECT_LT(spot[0].compliance_mm_per_N, 0.92 * spot[1].compliance_mm_per_N);
}

TEST(YieldSolver, AFrameIsAWholeNumberOfTicks) {
  EXPECT_EQ(ticks_of_yield_frame(1000), 16u);
  EXPECT_EQ(ticks_of_yield_frame(250), 4u);
  EXPECT_EQ(ticks_of_yield_frame(10'000), 156u);
  EXPECT_EQ(ticks_of_yield_frame(20), 1u);
}

}  // namespace
}  // namespace palpate
