#include "verification/stability_buzz.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

// last second at a position on the plates, 1 N/mm
HoldResult hold_at_position(ForceMethod method, const char* grip, const std::string& position_name,
                            PreparationMethod preparation = PreparationMethod::kUnionGaussian) {
  static const auto union_model = two_plates(1, PreparationMethod::kUnionGaussian),
                    ramp_model = two_plates(1, PreparationMethod::kInwardRamp);
  const auto& model = preparation == PreparationMethod::kUnionGaussian ? union_model : ramp_model;
  PALPATE_CHECK(model.ok());
  const PlantHand hand = *find_plant_hand(grip);
  for (const HoldPosition& hold_position : hold_positions(**model, method, hand)) {
    if (hold_position.name != position_name) continue;
    const auto tip = hold_tip(**model, {*find_plant_device("premium-1.5"), hand, method, 1000, 1e-3, 1,
                                        hold_position.from, hold_position.at});
    PALPATE_CHECK(tip.ok());
    return *tip;
  }
  ADD_FAILURE() << "no place " << position_name;
  return {};
}

TEST(BuzzOnPlates, AWallIsHeldQuietlyAtOneNewtonByEveryMethod) {
  for (const ForceMethodInfo& info : kForceMethods) {
    const HoldResult tip = hold_at_position(info.method, "firm-grip", "wall");
    EXPECT_TRUE(tip.quiet()) << info.name;
    // within Coulomb friction, an encoder step and the position of the prepared face
    EXPECT_NEAR(tip.buzz.force_N, 1, 0.1) << info.name;
  }
}

TEST(BuzzOnPlates, ARampIsHeldQuietlyAtOneNewtonAndLeavesTheGapAlone) {
  const auto methods = methods_on(PreparationMethod::kInwardRamp);
  EXPECT_EQ(methods.size(), 3u) << "that read the field";
  for (const ForceMethodInfo& info : methods) {
    const HoldResult wall =
        hold_at_position(info.method, "firm-grip", "wall", PreparationMethod::kInwardRamp);
    EXPECT_TRUE(wall.quiet()) << info.name;
    EXPECT_NEAR(wall.buzz.force_N, 1, 0.1) << info.name;
    const HoldResult gap = hold_at_position(info.method, "light-grip", "gap", PreparationMethod::kInwardRamp);
    // outside, a spline overshoots by some thousandths where the ramp begins
    EXPECT_LT(gap.buzz.force_N, 0.005) << info.name;
    EXPECT_EQ(gap.buzz.peak_to_peak_um, 0) << info.name;
  }
}

TEST(BuzzOnPlates, BetweenThemAWideUnionGivesOutEnergy) {
  // motivating defect: smoothed wider than the gap, the field pushes from side to side
  const HoldResult tip = hold_at_position(ForceMethod::kTrilinear, "light-grip", "gap");
  EXPECT_FALSE(tip.quiet());
  EXPECT_GT(tip.buzz.energy_mJ, 0);
}

TEST(BuzzOnPlates, BetweenThemTheProxyLeavesTheTipAlone) {
  const HoldResult tip = hold_at_position(ForceMethod::kProxy, "light-grip", "gap");
  EXPECT_EQ(tip.buzz.peak_to_peak_um, 0);
  EXPECT_EQ(tip.buzz.force_N, 0);
}

}  // namespace
}  // namespace palpate
