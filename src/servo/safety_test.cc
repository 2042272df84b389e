#include "servo/safety.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "palpate/telemetry.h"

namespace palpate {
namespace {

TEST(Safety, PassesWhatIsWithinTheLimitUntouched) {
  const Wrench asked{Vector<World>(0.3, -0.4, 0), Vector<World>(1, 2, 3)};
  const SafeWrench safe = make_safe(asked, 0.5, false);
  EXPECT_EQ(safe.wrench.force_N, asked.force_N);
  EXPECT_EQ(safe.wrench.torque_Nmm, asked.torque_Nmm);
  EXPECT_EQ(safe.flags, 0u);
}

TEST(Safety, ClampsTheMagnitudeAndKeepsTheDirection) {
  const auto seed = std::random_device{}();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> component(-1, 1), exponent(-300, 300), limit(0.01, 40);
  for (int i = 0; i < 1000000; ++i) {
    const Vector<World> direction(component(random), component(random), component(random));
    const Wrench asked{direction * std::pow(10, exponent(random)), direction};
    const double max_N = limit(random);
    const SafeWrench safe = make_safe(asked, max_N, false);
    ASSERT_LE(safe.wrench.force_N.norm(), max_N);
    if (safe.flags & kFlagClamped) {
      ASSERT_NEAR(safe.wrench.force_N.norm(), max_N, 1e-12 * max_N);
      ASSERT_NEAR(safe.wrench.force_N.normalized().dot(direction.normalized()), 1, 1e-12);
    } else {
      ASSERT_EQ(safe.wrench.force_N, asked.force_N);
    }
  }
}

TEST(Safety, ScalesTheTorqueAlike) {
  const SafeWrench safe = make_safe({Vector<World>(0, 8, 0), Vector<World>(4, 0, -2)}, 2, false);
  EXPECT_NEAR(safe.wrench.torque_Nmm.x(), 1, 1e-12);
  EXPECT_NEAR(safe.wrench.torque_Nmm.z(), -0.5, 1e-12);
}

TEST(Safety, WhatIsNotFiniteBecomesNothing) {
  const double bad[] = {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                        -std::numeric_limits<double>::infinity()};
  for (const double value : bad)
    for (int axis = 0; axis < 3; ++axis)
      for (const bool in_torque : {false, true}) {
        Wrench asked{Vector<World>(0.1, 0.1, 0.1), Vector<World>()};
        (in_torque ? asked.torque_Nmm : asked.force_N)[axis] = value;
        const SafeWrench safe = make_safe(asked, 3, false);
        EXPECT_EQ(safe.wrench.force_N, Vector<World>());
        EXPECT_EQ(safe.wrench.torque_Nmm, Vector<World>());
        EXPECT_EQ(safe.flags, kFlagNotFinite);
      }
}

TEST(Safety, ALimitThatIsNoNumberLetsNothingThrough) {
  for (const double limit : {std::nan(""), -1.0, 0.0, std::numeric_limits<double>::infinity()})
    EXPECT_EQ(make_safe({Vector<World>(0, 1, 0), {}}, limit, false).wrench.force_N, Vector<World>()) << limit;
}

TEST(Safety, PausedIsSilent) {
  const SafeWrench safe = make_safe({Vector<World>(0, 1, 0), {}}, 3, true);
  EXPECT_EQ(safe.wrench.force_N, Vector<World>());
  EXPECT_EQ(safe.flags, kFlagPaused);
}

}  // namespace
}  // namespace palpate
