#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "palpate/device/bounds.h"
#include "palpate/stability/stability.h"

/// A device that follows another's clock, held at a wall: what the delay of following costs, and that who
/// counts on it is quiet.
namespace palpate {
namespace {

constexpr double kTick_s = 1e-3;
constexpr int kTicksPerUpdate = 4;

/// Peak to peak of the true tip in the third second of a hold with 1 N, in steps of its encoder. As
/// SeveralDrivers has it: a tick answers the newest state, and an update sends what the last tick has left.
double swing_steps(const PlantDevice& plant, const char* grip, double stiffness_N_per_mm) {
  const PlantHand hand = *find_plant_hand(grip);
  SimulatedDevice device(plant, hand);
  device.reset(Point<Device>(0.5, 0, 0));
  const double pressed_mm = 1e3 / hand.stiffness_N_per_m + 1 / stiffness_N_per_mm;
  DeviceCommand acting, left;
  DeviceSample told = device.read();
  double low_mm = 1e9, high_mm = -1e9;
  for (int tick = 0; tick < 3000; ++tick) {
    // at 0.1 m/s into the wall, which lies below x = 0
    device.intend(Point<Device>(std::max(-pressed_mm, 0.5 - 100 * kTick_s * tick), 0, 0));
    if (tick % kTicksPerUpdate == 0) {
      told = device.read();
      acting = left;
    }
    left.force_N = Vector<Device>(stiffness_N_per_mm * std::max(0.0, -told.tip.x()), 0, 0);
    device.advance(acting, kTick_s);
    if (tick < 2000) continue;
    low_mm = std::min(low_mm, device.true_tip().x());
    high_mm = std::max(high_mm, device.true_tip().x());
  }
  return (high_mm - low_mm) / (plant.encoder_step_m * 1e3);
}

TEST(Following, AtWhatIsRecommendedForItsDelayADeviceIsAsQuietAsAlone) {
  const double rate_hz = 1 / (kTicksPerUpdate * kTick_s);
  const double delay_s = kTicksPerUpdate * kTick_s + kTick_s;
  for (const PlantDevice& plant : known_plant_devices()) {
    const auto recommended = recommended_stiffness_N_per_mm(plant, rate_hz, delay_s);
    ASSERT_TRUE(recommended.ok());
    DeviceInfo info;
    info.rate_hz = rate_hz;
    info.delay_s = delay_s;
    const double careful = careful_bounds(info).stiffness_N_per_mm;
    const auto alone_without = recommended_stiffness_N_per_mm(plant, 1 / kTick_s, 0);
    ASSERT_TRUE(alone_without.ok());
    RecordProperty(plant.name + " recommended", std::to_string(*recommended));
    RecordProperty(plant.name + " alone", std::to_string(*alone_without));
    for (const char* grip : {"light-grip", "firm-grip"}) {
      EXPECT_LE(swing_steps(plant, grip, *recommended), 2) << plant.name << " " << grip;
      EXPECT_LE(swing_steps(plant, grip, careful), 2) << plant.name << " " << grip;
    }
    // what it would bear alone at the owner's rate it does not bear here: the delay must be counted
    EXPECT_GT(swing_steps(plant, "light-grip", *alone_without), 10) << plant.name;
    EXPECT_LT(careful, *recommended) << "who knows less is more careful";
  }
}

}  // namespace
}  // namespace palpate
