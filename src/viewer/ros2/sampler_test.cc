#include "ros2/sampler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "palpate/base/check.h"
#include "server/test_host.h"

namespace palpate::ros2 {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

Eigen::Quaterniond turn_of(const std::array<double, 4>& xyzw) {
  return {xyzw[3], xyzw[0], xyzw[1], xyzw[2]};
}
Eigen::Vector3d vector_of(const std::array<double, 3>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

/// One tick of a device in an object that is rotated about World's origin.
struct Touching {
  Touching() {
    tick.rotation_applied_wxyz = {0.5, 0.5, -0.5, 0.5};
    DeviceTick& device = tick.device[0];
    device.tip_patient_mm = {10, -20, 30};
    device.proxy_patient_mm = {11, -20, 30};
    device.orientation_wxyz = {std::sqrt(0.5), 0, 0, std::sqrt(0.5)};
    device.velocity_patient_mm_s = {1000, 0, -500};
    device.angular_velocity_world_rad_s = {0.1, 0.2, 0.3};
    device.force_N = {1, 2, 3};
    device.torque_Nmm = {4, 5, 6};
    device.near_label = {2, 1};
    device.near_mm = {1.5, -2};
  }
  testing::FakeHost host;
  TickRecord tick;
};

TEST(Sampler, PositionsAreInMetresInThePatient) {
  const Touching touching;
  HandSample sample;
  ASSERT_TRUE(Sampler(touching.host.scene()).convert(touching.tick, 0, sample));
  EXPECT_THAT(sample.tool.position_m, ElementsAre(0.01, -0.02, 0.03));
  EXPECT_THAT(sample.proxy.position_m, ElementsAre(0.011, -0.02, 0.03));
  EXPECT_THAT(sample.velocity_m_s, ElementsAre(1, 0, -0.5));
  EXPECT_THAT(sample.distances, ElementsAre(Pair("tibia", 0.0015), Pair("femur", -0.002)));
}

// A vector of World, taken to the patient and by the tool's published orientation back to the tool, is what
// the device's own orientation makes of it.
TEST(Sampler, WrenchAndOrientationAreOfOneFrame) {
  const Touching touching;
  HandSample sample;
  ASSERT_TRUE(Sampler(touching.host.scene()).convert(touching.tick, 0, sample));
  const DeviceTick& device = touching.tick.device[0];
  const Eigen::Quaterniond R_WorldTool(device.orientation_wxyz[0], device.orientation_wxyz[1],
                                       device.orientation_wxyz[2], device.orientation_wxyz[3]);
  const Eigen::Vector3d in_tool = R_WorldTool.inverse() * vector_of(device.force_N);
  EXPECT_LT((turn_of(sample.tool.orientation_xyzw).inverse() * vector_of(sample.force_N) - in_tool).norm(),
            1e-12);
  EXPECT_LT((turn_of(sample.tool.orientation_xyzw).inverse() * vector_of(sample.torque_Nm) -
             R_WorldTool.inverse() * vector_of(device.torque_Nmm) / 1000)
                .norm(),
            1e-12);
  // the rotation by 120 degrees takes x, y, z of the unrotated object to -y, -z, x of World; the scene's own
  // matrix comes before it
  const auto& matrix = touching.host.scene().world_from_patient;
  Eigen::Matrix3d R_WorldPatient;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c)
      R_WorldPatient(static_cast<int>(r), static_cast<int>(c)) = matrix[r][c];
  const Eigen::Quaterniond applied(0.5, 0.5, -0.5, 0.5);
  EXPECT_LT((applied * (R_WorldPatient * vector_of(sample.force_N)) - vector_of(device.force_N)).norm(),
            1e-12);
}

TEST(Sampler, ADeviceWithoutAPoseIsLeftOut) {
  Touching touching;
  touching.tick.device[0].tip_patient_mm[1] = kNoValue;
  HandSample sample;
  EXPECT_FALSE(Sampler(touching.host.scene()).convert(touching.tick, 0, sample));
}

// x anterior, y left, z superior
TEST(Sampler, TheBaseFrameIsThatOfRep103) {
  const Eigen::Quaterniond R_BasePatient = turn_of(patient_in_base().orientation_xyzw);
  const Eigen::Vector3d left(1, 0, 0), posterior(0, 1, 0), superior(0, 0, 1);
  EXPECT_LT((R_BasePatient * -posterior - Eigen::Vector3d(1, 0, 0)).norm(), 1e-12);
  EXPECT_LT((R_BasePatient * left - Eigen::Vector3d(0, 1, 0)).norm(), 1e-12);
  EXPECT_LT((R_BasePatient * superior - Eigen::Vector3d(0, 0, 1)).norm(), 1e-12);
}

TEST(Sampler, TheSceneNamesItsStructures) {
  const testing::FakeHost host;
  EXPECT_EQ(scene_text(host.scene()),
            R"({"structures":[{"label":1,"name":"femur"},{"label":2,"name":"tibia"}]})");
}

// Ticks are read up to a period late; the stamps are regular within a tenth of that, and no later than the
// reading.
TEST(TickClock, StampsAreAsRegularAsTicks) {
  constexpr unsigned kSeed = 7;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_int_distribution<std::int64_t> age_ns(0, 1'000'000);
  TickClock clock;
  constexpr std::int64_t kStart_ns = 1'800'000'000'000'000'000;
  std::int64_t previous_ns = 0;
  for (int n = 0; n < 5000; ++n) {
    const std::int64_t tick_ns = n * std::int64_t{1'000'000}, now_ns = kStart_ns + tick_ns + age_ns(random);
    const std::int64_t stamp_ns = clock.stamp_ns(1e-9 * static_cast<double>(tick_ns), now_ns);
    ASSERT_LE(stamp_ns, now_ns);
    if (n > 1000) {
      ASSERT_NEAR(static_cast<double>(stamp_ns - previous_ns), 1e6, 1e5) << n;
      ASSERT_NEAR(static_cast<double>(stamp_ns - kStart_ns - tick_ns), 0, 1e5) << n;
    }
    previous_ns = stamp_ns;
  }
}

TEST(TickClock, FollowsAnAdjustedClockAndAnotherRun) {
  TickClock clock;
  EXPECT_EQ(clock.stamp_ns(1, 5'000'000'000), 5'000'000'000);
  EXPECT_EQ(clock.stamp_ns(1.001, 9'001'000'000), 9'001'000'000);
  EXPECT_EQ(clock.stamp_ns(1.002, 4'002'000'000), 4'002'000'000);
  EXPECT_EQ(clock.stamp_ns(0, 6'000'000'000), 6'000'000'000);
}

}  // namespace
}  // namespace palpate::ros2
