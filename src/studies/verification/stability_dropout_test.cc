#include "verification/stability_dropout.h"

#include <gtest/gtest.h>

#include "verification/stability_wall.h"

namespace palpate {
namespace {

DropoutResult dropped_out(const std::string& device, const std::string& hand, double time_s,
                          ReturningForce returning = ReturningForce::kByTick) {
  static const auto wall = flat_wall();
  PALPATE_CHECK(wall.ok());
  return drop_out(**wall,
                  {*find_plant_device(device), *find_plant_hand(hand), 1.16, 1e-3, time_s, 1, returning});
}

TEST(StabilityDropout, AHandThatPressesIsHeldAgainSoonAfterAShortOne) {
  const struct {
    const char* hand;
    double max_sinking_mm, max_back_s;
  } hands[] = {{"light-grip", 1.25, 0.1}, {"firm-grip", 0.95, 0.1}, {"whole-arm", 0.6, 0.1}};
  for (const char* device : {"premium-1.5", "touch"})
    for (const auto& [hand, max_sinking_mm, max_back_s] : hands) {
      SCOPED_TRACE(std::string(device) + ", " + hand);
      const DropoutResult lost = dropped_out(device, hand, 20e-3);
      EXPECT_NEAR(lost.before_N, 1, 0.2);
      EXPECT_TRUE(lost.silent);
      EXPECT_LT(lost.sinking_mm, max_sinking_mm);
      EXPECT_LT(lost.back_s, max_back_s);
      EXPECT_LE(lost.kick_N, kMaxKick_N);
    }
}

// Zero force from an age of 10 ms on and an increase of at most 0.2 N per tick cause a minimum of sinking for
// each hand; the tick is within a tenth of a millimetre of it.
TEST(StabilityDropout, AHandSinksHardlyMoreThanZeroAndNoKickCost) {
  for (const char* device : {"premium-1.5", "touch"})
    for (const char* hand : {"light-grip", "firm-grip", "whole-arm"}) {
      SCOPED_TRACE(std::string(device) + ", " + hand);
      const double sinking_mm = dropped_out(device, hand, 20e-3).sinking_mm;
      const double floor_mm = dropped_out(device, hand, 20e-3, ReturningForce::kWithoutKick).sinking_mm;
      EXPECT_GE(sinking_mm, floor_mm - 1e-9);
      EXPECT_LT(sinking_mm, floor_mm + 0.1);
      EXPECT_LT(dropped_out(device, hand, 20e-3, ReturningForce::kAtOnce).sinking_mm, sinking_mm);
    }
}

TEST(StabilityDropout, ALongerOneComesBackByTheRamp) {
  const DropoutResult lost = dropped_out("premium-1.5", "firm-grip", 21e-3);
  EXPECT_TRUE(lost.silent);
  EXPECT_GT(lost.sinking_mm, 2) << "as far as the hand's spring lets it";
  EXPECT_GT(lost.back_s, 0.1);
}

}  // namespace
}  // namespace palpate
