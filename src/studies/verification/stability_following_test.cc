#include "verification/stability_following.h"

#include <gtest/gtest.h>

#include "palpate/device/bounds.h"
#include "palpate/stability/stability.h"
#include "verification/stability_wall.h"

/// Latency of following, and stability when it is taken into account.
namespace palpate {
namespace {

const Model& followed_wall() {
  static const auto wall = flat_wall();
  PALPATE_CHECK(wall.ok());
  return **wall;
}

double steps(const PressResult& pressed, const PressingDevice& pressing) {
  return pressed.swing_mm / (pressing.device.encoder_step_m * 1e3);
}

TEST(Following, RecommendedStiffnessForTheDelayIsStable) {
  for (const PlantDevice& plant : known_plant_devices())
    for (const char* grip : {"light-grip", "firm-grip"}) {
      SCOPED_TRACE(plant.name + ", " + grip);
      const PlantHand hand = *find_plant_hand(grip);
      Following both{{*find_plant_device("premium-1.5"), hand}, {plant, hand}};
      both.follower.rate_hz = 250;
      const double delay_s = following_delay_s(both.owner, both.follower);
      EXPECT_NEAR(delay_s, 6e-3, 1e-12);
      both.owner.stiffness_N_per_mm =
          *recommended_stiffness_N_per_mm(both.owner.device, 1000, both.owner.delay_s);
      const double recommended = *recommended_stiffness_N_per_mm(plant, 250, delay_s);
      DeviceInfo info;
      info.rate_hz = 250;
      info.delay_s = delay_s;
      const double careful = conservative_bounds(info).stiffness_N_per_mm;
      EXPECT_LT(careful, recommended) << "who knows less is more careful";

      const PressResult owner_alone = press_alone(followed_wall(), both.owner);
      for (const double stiffness_N_per_mm : {recommended, careful}) {
        both.follower.stiffness_N_per_mm = stiffness_N_per_mm;
        const auto [owner, follower] = run_following(followed_wall(), both);
        EXPECT_LE(steps(follower, both.follower), 2) << stiffness_N_per_mm;
        EXPECT_NEAR(follower.force_N, 1, 0.2);
        // the owner is unaffected by the follower
        EXPECT_EQ(owner.swing_mm, owner_alone.swing_mm);
        EXPECT_EQ(owner.force_N, owner_alone.force_N);
        EXPECT_LE(steps(owner, both.owner), 2);
      }
    }
}

// The latency of following has to be counted: the stiffness that is stable for the device alone is not stable
// here.
TEST(Following, StableStiffnessIsLowerForAFollower) {
  for (const PlantDevice& plant : known_plant_devices()) {
    SCOPED_TRACE(plant.name);
    const PlantHand hand = *find_plant_hand("light-grip");
    Following both{{plant, hand}, {plant, hand}};
    both.controller = both.is_delay_counted = false;
    both.owner.delay_s = both.follower.delay_s = 0;
    both.follower.stiffness_N_per_mm = *recommended_stiffness_N_per_mm(plant, 1000, 0);
    EXPECT_LE(steps(press_alone(followed_wall(), both.follower, false), both.follower), 2)
        << "alone at 1 kHz";
    both.follower.rate_hz = 250;
    const auto [owner, follower] = run_following(followed_wall(), both);
    EXPECT_GT(steps(follower, both.follower), 10);
  }
}

}  // namespace
}  // namespace palpate
