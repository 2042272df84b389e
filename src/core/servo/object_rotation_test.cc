#include "servo/object_rotation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "contact/test_model.h"

namespace palpate {
namespace {

constexpr double kTurnTick_s = 1e-3, kWall_N_per_mm = 1.5, kLever_mm = 20;

/// A wall of 1.5 N/mm below the plane z = 0 of World, which rotates about World's x axis, and tips above y =
/// 20 mm, where a rotation lifts the surface by 20 mm times the sine of its angle. No friction, passivity
/// controller or slew.
struct TurningWall {
  Model model = testing::ball_model({2, 2, 2});
  Parameters parameters;
  SessionState state;
  std::array<Wrench, 2> wrenches;
  TickRecord record;

  TurningWall() {
    // below is posterior, +y of the patient
    const GridGeometry grid = model.labels->geometry();
    const auto depth_mm = [](const Eigen::Vector3d& p) { return -p.y(); };
    Volume<LabelId> labels(grid);
    for (std::size_t v = 0; v < grid.voxel_count(); ++v)
      labels.voxels()[v] =
          static_cast<int>(v) / grid.dims[0] % grid.dims[1] > grid.dims[1] / 2 ? testing::kBone : LabelId{0};
    model.labels = label_bricks(labels);
    ContactSurface wall = testing::make_contact_surface(grid, depth_mm, 20);
    wall.stiffness_N_per_mm = kWall_N_per_mm;
    model.surfaces = {wall};
    model.label_of_surface = {testing::kBone};
    parameters.method = ForceMethod::kProxy;
    parameters.friction = parameters.viscosity = parameters.passivity = false;
    parameters.max_force_N = 100;
    for (DeviceParameters& device : parameters.device)
      device.limits.slew_N_per_s = std::numeric_limits<double>::infinity();
    for (auto& hand : state.device) hand.output.gain = 1;
  }

  void at(const Point<World>& tip, const Point<World>& other = {0, 0, 40}, double dt_s = kTurnTick_s) {
    std::array<DeviceState, 2> devices;
    devices[0].tip = tip;
    devices[1].tip = other;
    tick(model, parameters, devices, dt_s, state, wrenches, record);
  }
  static Point<World> tip_at(double height_mm) { return {0, kLever_mm, height_mm}; }
  // pressed from above until the contact force is reached
  void press(double force_N) {
    for (int n = 0; n <= 100; ++n) at(tip_at(1 - n * 0.01 * (1 + force_N / kWall_N_per_mm)));
    ASSERT_NEAR(force(), force_N, 1e-3);
  }
  void turn_to(double radians) {
    parameters.rotation_target = Eigen::Quaterniond(Eigen::AngleAxisd(radians, Eigen::Vector3d::UnitX()));
  }
  double force() const { return wrenches[0].force_N.norm(); }
  double turned() const { return 2 * std::asin(record.rotation_applied_wxyz[1]); }
};

// analytic: all power goes into the spring between the wall and a hand that does not move, F^2 = F0^2 + 2 K P
// t
TEST(ObjectRotation, FixedTipForceGrowsWithConstantPower) {
  for (const double begins_N : {0.2, 1.0, 3.0}) {
    SCOPED_TRACE(begins_N);
    TurningWall wall;
    ASSERT_NO_FATAL_FAILURE(wall.press(begins_N));
    const Point<World> resting = TurningWall::tip_at(-begins_N / kWall_N_per_mm);
    const double energy_mJ = wall.record.device[0].energy_mJ;
    wall.turn_to(0.3);
    for (int n = 1; n <= 400; ++n) {
      wall.at(resting);
      const double fed_mJ = kRotationSettings.max_power_mW * n * kTurnTick_s;
      const double expected_N = std::sqrt(begins_N * begins_N + 2 * kWall_N_per_mm * fed_mJ);
      // at an angle of 0.1 the wall also pushes sideways
      ASSERT_NEAR(wall.force(), expected_N, 0.01 * expected_N) << n;
      ASSERT_LE(wall.record.device[0].turned_mJ, fed_mJ * (1 + 1e-3)) << n;
      ASSERT_TRUE(wall.record.device[0].flags & kFlagRotationLimited) << n;
    }
    EXPECT_NEAR(wall.record.device[0].turned_mJ, kRotationSettings.max_power_mW * 0.4, 0.05);
    // the contact's passivity observer stays relative to the object: the spring holds the energy of both
    const double stored_energy_mJ =
        0.5 * (wall.force() * wall.force() - begins_N * begins_N) / kWall_N_per_mm;
    EXPECT_NEAR(wall.record.device[0].energy_mJ - energy_mJ, stored_energy_mJ, 0.05 * stored_energy_mJ);
  }
}

// the opposite direction: the hand is not allowed to fall
TEST(ObjectRotation, RecedingSurfaceForceFallsWithConstantPower) {
  TurningWall wall;
  ASSERT_NO_FATAL_FAILURE(wall.press(1));
  const Point<World> resting = TurningWall::tip_at(-1 / kWall_N_per_mm);
  wall.turn_to(-0.3);
  for (int n = 1; n <= 60; ++n) {
    wall.at(resting);
    EXPECT_NEAR(wall.force(),
                std::sqrt(1 - 2 * kWall_N_per_mm * kRotationSettings.max_power_mW * n * kTurnTick_s), 0.03)
        << n;
  }
}

// P / F: the speed at which a compliant hand is displaced
TEST(ObjectRotation, CompliantTipSpeedIsAtMostPowerOverForce) {
  constexpr double kHand_N = 1;
  TurningWall wall;
  ASSERT_NO_FATAL_FAILURE(wall.press(kHand_N));
  wall.turn_to(0.3);
  double height_mm = -kHand_N / kWall_N_per_mm;
  constexpr int kTicks = 400;
  for (int n = 0; n < kTicks; ++n) {
    height_mm += 0.5 * (wall.force() - kHand_N) / kWall_N_per_mm;
    wall.at(TurningWall::tip_at(height_mm));
    ASSERT_LT(wall.force(), 1.05 * kHand_N);
  }
  const double displacement_mm = height_mm + kHand_N / kWall_N_per_mm;
  EXPECT_NEAR(displacement_mm, kRotationSettings.max_power_mW * kTicks * kTurnTick_s / kHand_N, 0.1);
}

// attack: 25 degrees back and forth at 6.7 Hz, 1.4 N per tick
TEST(ObjectRotation, RapidRotationCommandsAreLimited) {
  TurningWall wall;
  ASSERT_NO_FATAL_FAILURE(wall.press(1));
  const Point<World> resting = TurningWall::tip_at(-1 / kWall_N_per_mm);
  double before_N = wall.force(), before_mJ = 0, largest_step_N = 0, min_N = before_N, max_N = before_N;
  for (int n = 0; n < 3000; ++n) {
    if (n % 75 == 0) wall.turn_to(n / 75 % 2 == 0 ? 0.436 : -0.436);
    wall.at(resting);
    const DeviceTick& device = wall.record.device[0];
    EXPECT_LE(std::abs(device.turned_mJ - before_mJ),
              kRotationSettings.max_power_mW * kTurnTick_s * (1 + 1e-6))
        << n;
    largest_step_N = std::max(largest_step_N, std::abs(wall.force() - before_N));
    min_N = std::min(min_N, wall.force());
    max_N = std::max(max_N, wall.force());
    before_N = wall.force();
    before_mJ = device.turned_mJ;
  }
  EXPECT_LE(largest_step_N, kRotationSettings.max_step_N * 1.01);
  // the energy of half a period
  EXPECT_LE(max_N, std::sqrt(1 + 2 * kWall_N_per_mm * kRotationSettings.max_power_mW * 0.075) + 0.05);
  EXPECT_GE(min_N, 0);
}

TEST(ObjectRotation, ApproachSpeedOfASurfaceIsLimited) {
  TurningWall wall;
  const Point<World> above = TurningWall::tip_at(2);
  for (int n = 0; n < 20; ++n) wall.at(above);
  wall.turn_to(0.3);
  double before = 0, before_N = 0;
  for (int n = 0; n < 100; ++n) {
    wall.at(above);
    EXPECT_LE((wall.turned() - before) * std::hypot(kLever_mm, 2),
              kRotationSettings.max_speed_mm_s * kTurnTick_s * (1 + 1e-3));
    EXPECT_LE(wall.force() - before_N, kRotationSettings.max_step_N * 1.01) << n;
    before = wall.turned();
    before_N = wall.force();
  }
  EXPECT_GT(before_N, 0.3) << "it was met";
  EXPECT_GT(before, 0.9 * 2 / kLever_mm) << "and not before";
}

TEST(ObjectRotation, RotationIsUnlimitedWithoutForce) {
  for (const bool stopped : {false, true}) {
    TurningWall wall;
    ASSERT_NO_FATAL_FAILURE(wall.press(1));
    const Point<World> resting = TurningWall::tip_at(-1 / kWall_N_per_mm);
    (stopped ? wall.parameters.emergency_stop : wall.parameters.paused) = true;
    for (int n = 0; n < 200; ++n) wall.at(resting);
    wall.turn_to(0.3);
    for (int n = 0; n < 101; ++n) wall.at(resting);
    EXPECT_NEAR(wall.turned(), 0.3, 1e-9);
    EXPECT_EQ(wall.record.device[0].turned_mJ, 0);
    EXPECT_EQ(wall.record.device[0].flags & kFlagRotationLimited, 0u);
  }
  // a non-finite pose does not stop the rotation
  TurningWall wall;
  wall.at(TurningWall::tip_at(5));
  wall.turn_to(0.3);
  for (int n = 0; n < 101; ++n) wall.at({0, std::nan(""), 0}, {0, 0, std::nan("")});
  EXPECT_NEAR(wall.turned(), 0.3, 1e-9);
}

TEST(ObjectRotation, EachDeviceLimitsTheRotationAndHasItsOwnAccount) {
  TurningWall one, both;
  for (TurningWall* wall : {&one, &both}) ASSERT_NO_FATAL_FAILURE(wall->press(0.2));
  const Point<World> resting = TurningWall::tip_at(-0.2 / kWall_N_per_mm);
  // the other device's lever is half as long, on the other side, and it presses with 2 N: the wall moves away
  // from it
  const Point<World> above(0, -10, 1), pressed(0, -10, -2 / kWall_N_per_mm);
  for (int n = 0; n <= 100; ++n) both.at(resting, above + (pressed - above) * (0.01 * n));
  // the displacement from its earlier position is a jump, after which the force ramps in
  for (int n = 0; n < 600; ++n) both.at(resting, pressed);
  EXPECT_NEAR(both.wrenches[1].force_N.norm(), 2, 1e-3);
  for (TurningWall* wall : {&one, &both}) wall->turn_to(0.3);
  for (int n = 0; n < 20; ++n) {
    one.at(resting);
    both.at(resting, pressed);
  }
  EXPECT_LT(both.turned(), 0.6 * one.turned());
  EXPECT_TRUE(both.record.device[1].flags & kFlagRotationLimited);
  EXPECT_LT(both.record.device[1].turned_mJ, -0.9 * kRotationSettings.max_power_mW * 0.02)
      << "the hand on the object";
  EXPECT_GT(both.record.device[0].turned_mJ, 0);
}

// the limits apply at the device, including scale and gain
TEST(ObjectRotation, LimitsApplyInDeviceUnits) {
  TurningWall wall;
  wall.parameters.device[0].scale = 4;
  wall.parameters.device[0].force_gain = 0.5;
  for (int n = 0; n <= 100; ++n) wall.at(TurningWall::tip_at(1 - 0.03 * n));
  const double begins_N = 0.5 * 2 * kWall_N_per_mm;
  ASSERT_NEAR(wall.force(), begins_N, 1e-3);
  wall.turn_to(0.3);
  for (int n = 1; n <= 100; ++n) wall.at(TurningWall::tip_at(-2));
  // a device millimetre is four patient millimetres: 3 N/mm
  EXPECT_NEAR(wall.force(), std::sqrt(begins_N * begins_N + 2 * 3 * kRotationSettings.max_power_mW * 0.1),
              0.01);
}

// work recomputed from the records
TEST(ObjectRotation, WorkPerTickIsBoundedForRandomMotions) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> any(-1, 1);
  TurningWall wall;
  wall.parameters.friction = true;
  Point<World> tip = TurningWall::tip_at(3);
  double counted_mJ = 0;
  int limited = 0;
  for (int n = 0; n < 20'000; ++n) {
    if (n % 37 == 0)
      wall.parameters.rotation_target = Eigen::Quaterniond(Eigen::AngleAxisd(
          any(random), Eigen::Vector3d(any(random), any(random), any(random)).normalized()));
    if (n % 501 == 0) wall.parameters.paused = !wall.parameters.paused;
    tip += Vector<World>(any(random), any(random), any(random) - 0.05 * (tip.z() + 1)) * 0.3;
    const SessionState::DeviceSession before = wall.state.device[0];
    const Eigen::Quaterniond from = wall.state.rotation_applied;
    const double dt_s = kTurnTick_s * (1 + 0.5 * any(random));
    wall.at(tip, {0, 0, 40}, dt_s);
    const Eigen::Vector3d lever = (wall.model.X_WorldPatient * before.previous_tip).eigen();
    const Eigen::Vector3d displacement_mm = wall.state.rotation_applied * lever - from * lever;
    const double work_mJ = before.has_previous ? before.output.sent.force_N.eigen().dot(displacement_mm) : 0;
    counted_mJ += work_mJ;
    EXPECT_LE(std::abs(work_mJ), kRotationSettings.max_power_mW * dt_s * (1 + 1e-3)) << n;
    limited += (wall.record.device[0].flags & kFlagRotationLimited) != 0;
  }
  EXPECT_NEAR(wall.record.device[0].turned_mJ, counted_mJ, 1e-9);
  EXPECT_GT(limited, 1000);
}

}  // namespace
}  // namespace palpate
