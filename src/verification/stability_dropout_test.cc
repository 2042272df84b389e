#include "verification/stability_dropout.h"

#include <gtest/gtest.h>

#include "verification/stability_wall.h"

namespace palpate {
namespace {

DroppedOut dropped_out(const std::string& device, const std::string& hand, double time_s) {
  static const auto wall = flat_wall();
  PALPATE_CHECK(wall.ok());
  return drop_out(**wall, {*find_plant_device(device), *find_plant_hand(hand), 1.16, 1e-3, time_s});
}

// Zero from 10 ms of age on, and 0.2 N a tick on the way back, cost a hand of 0.2 kg some 0.7 mm whatever
// comes after.
TEST(StabilityDropout, AHandThatPressesIsHeldAgainSoonAfterAShortOne) {
  const struct {
    const char* hand;
    double most_sink_mm, most_back_s;
  } hands[] = {{"light-grip", 1.3, 0.1}, {"firm-grip", 1.0, 0.1}, {"whole-arm", 0.6, 0.15}};
  for (const char* device : {"premium-1.5", "touch"})
    for (const auto& [hand, most_sink_mm, most_back_s] : hands) {
      SCOPED_TRACE(std::string(device) + ", " + hand);
      const DroppedOut lost = dropped_out(device, hand, 20e-3);
      EXPECT_NEAR(lost.before_N, 1, 0.2);
      EXPECT_TRUE(lost.silent);
      EXPECT_LT(lost.sink_mm, most_sink_mm);
      EXPECT_LT(lost.back_s, most_back_s);
      EXPECT_LE(lost.kick_N, 0.2);
    }
}

TEST(StabilityDropout, ALongerOneComesBackByTheRamp) {
  const DroppedOut lost = dropped_out("premium-1.5", "firm-grip", 21e-3);
  EXPECT_TRUE(lost.silent);
  EXPECT_GT(lost.sink_mm, 2) << "as far as the hand's spring lets it";
  EXPECT_GT(lost.back_s, 0.1);
}

}  // namespace
}  // namespace palpate
