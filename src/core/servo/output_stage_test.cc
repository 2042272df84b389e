#include "servo/output_stage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "base/test_seed.h"
#include "palpate/device/telemetry.h"

namespace palpate {
namespace {

constexpr double kTick_s = 1e-3;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// an output stage with given device and user limits, ticked once per call
struct Stage {
  OutputLimits limits{8, kNoValue, 500, 4};
  double max_force_N = 3;
  OutputState state;

  Output step(const OutputRequest& request, double dt_s = kTick_s) {
    return make_output(request, limits, max_force_N, dt_s, state);
  }
  Output step(const Vector<World>& force_N, double dt_s = kTick_s) { return step({{force_N, {}}}, dt_s); }
  // until the ramp has ended and the slew has reached the force
  void settle(const Vector<World>& force_N) {
    for (int n = 0; n < 1000; ++n) step(force_N);
  }
};

TEST(OutputStage, PassesWrenchWithinLimitsUnchanged) {
  Stage stage;
  const Wrench requested{Vector<World>(0.3, -0.4, 0), Vector<World>(1, 2, 3), 0.5};
  Output out;
  for (int n = 0; n < 1000; ++n) out = stage.step(OutputRequest{requested});
  EXPECT_EQ(out.wrench.force_N, requested.force_N);
  EXPECT_EQ(out.wrench.torque_Nmm, requested.torque_Nmm);
  EXPECT_EQ(out.wrench.gripper_N, requested.gripper_N);
  EXPECT_EQ(out.flags, 0u);
  EXPECT_EQ(out.limit_N, 3);
}

TEST(OutputStage, RampsInOverHalfASecondAndOutOverATenth) {
  Stage stage;
  const Vector<World> requested(0, 1, 0);
  double previous_N = 0;
  for (int n = 1; n <= 500; ++n) {
    const Output out = stage.step(requested);
    ASSERT_NEAR(out.wrench.force_N.y(), n * kTick_s / kOutputSettings.ramp_in_s, 1e-9);
    ASSERT_EQ((out.flags & kFlagRamp) != 0, n < 500) << n;
    ASSERT_GT(out.wrench.force_N.y(), previous_N);
    previous_N = out.wrench.force_N.y();
  }
  for (int n = 1; n <= 100; ++n) {
    const Output out = stage.step({{requested, {}}, 0, 0, true});
    ASSERT_NEAR(out.wrench.force_N.y(), 1 - n * kTick_s / kOutputSettings.ramp_out_s, 1e-9);
  }
  EXPECT_EQ(stage.step({{requested, {}}, 0, 0, true}).wrench.force_N, Vector<World>()) << "off while paused";
}

TEST(OutputStage, ClampKeepsDirectionAndScalesTorqueEqually) {
  Stage stage;
  const Wrench requested{Vector<World>(0, 6, 8), Vector<World>(40, 0, -20)};
  Output out;
  for (int n = 0; n < 1000; ++n) out = stage.step(OutputRequest{requested});
  EXPECT_NEAR(out.wrench.force_N.norm(), 3, 1e-12);
  EXPECT_NEAR(out.wrench.force_N.y() / out.wrench.force_N.z(), 0.75, 1e-12);
  EXPECT_NEAR(out.wrench.torque_Nmm.x(), 12, 1e-10);
  EXPECT_NEAR(out.wrench.torque_Nmm.z(), -6, 1e-10);
  EXPECT_TRUE(out.flags & kFlagClamped);
}

TEST(OutputStage, TorqueAboveItsLimitScalesTheForce) {
  Stage stage;
  stage.limits.peak_torque_Nmm = 100;
  Output out;
  for (int n = 0; n < 1000; ++n)
    out = stage.step(OutputRequest{{Vector<World>(1, 0, 0), Vector<World>(0, 200, 0)}});
  EXPECT_NEAR(out.wrench.torque_Nmm.y(), 100, 1e-9);
  EXPECT_NEAR(out.wrench.force_N.x(), 0.5, 1e-9);
}

TEST(OutputStage, SmallerOfDeviceAndUserLimitApplies) {
  Stage stage;
  stage.max_force_N = 40;
  stage.settle(Vector<World>(100, 0, 0));
  EXPECT_NEAR(stage.state.sent.force_N.x(), 8, 1e-12);
  // a lowered limit applies at once, regardless of the slew
  stage.max_force_N = 0.5;
  const Output out = stage.step(Vector<World>(100, 0, 0));
  EXPECT_NEAR(out.wrench.force_N.x(), 0.5, 1e-12);
}

TEST(OutputStage, UnknownLimitsDisableTorqueAndGripper) {
  Stage stage;
  stage.limits = OutputLimits{};
  stage.max_force_N = 2;
  Output out;
  for (int n = 0; n < 1000; ++n)
    out = stage.step(OutputRequest{{Vector<World>(9, 0, 0), Vector<World>(0, 5, 0), 1}});
  EXPECT_NEAR(out.wrench.force_N.x(), 2, 1e-12) << "forces are limited by the user's limit alone";
  EXPECT_EQ(out.wrench.torque_Nmm, Vector<World>()) << "without a known limit no torque is sent";
  EXPECT_EQ(out.wrench.gripper_N, 0);
}

TEST(OutputStage, NanLimitBlocksTheForce) {
  for (const double limit : {kNaN, -1.0, 0.0, kInfinity}) {
    Stage stage;
    stage.max_force_N = limit;
    stage.settle(Vector<World>(0, 1, 0));
    EXPECT_EQ(stage.state.sent.force_N, Vector<World>()) << limit;
  }
}

TEST(OutputStage, FaultZeroesAtOnceAndRampsIn) {
  for (const std::uint32_t fault :
       {kFlagNotFinite, kFlagJump, kFlagDeviceFault, kFlagHalted, kFlagEmergencyStop}) {
    Stage stage;
    stage.settle(Vector<World>(0, 2, 0));
    const Output out = stage.step({{Vector<World>(0, 2, 0), {}}, 0, fault});
    EXPECT_EQ(out.wrench.force_N, Vector<World>()) << "past the slew";
    EXPECT_EQ(out.flags, fault);
    EXPECT_NEAR(stage.step(Vector<World>(0, 2, 0)).wrench.force_N.y(),
                2 * kTick_s / kOutputSettings.ramp_in_s, 1e-12);
  }
}

TEST(OutputStage, NonFiniteWrenchBecomesZero) {
  for (const double bad : {kNaN, kInfinity, -kInfinity})
    for (int axis = 0; axis < 3; ++axis)
      for (const int part : {0, 1, 2}) {
        Stage stage;
        stage.settle(Vector<World>(0.1, 0.1, 0.1));
        Wrench requested{Vector<World>(0.1, 0.1, 0.1), {}};
        if (part == 0) requested.force_N[axis] = bad;
        if (part == 1) requested.torque_Nmm[axis] = bad;
        if (part == 2) requested.gripper_N = bad;
        const Output out = stage.step(OutputRequest{requested});
        EXPECT_EQ(out.wrench.force_N, Vector<World>());
        EXPECT_EQ(out.flags, kFlagNotFinite);
      }
}

TEST(OutputStage, ForceDecaysForPoseAgesOfFiveToTenMilliseconds) {
  const auto sent_at = [](double age_s) {
    Stage stage;
    stage.settle(Vector<World>(0, 2, 0));
    return stage.step({{Vector<World>(0, 2, 0), {}}, age_s}).wrench.force_N.y();
  };
  EXPECT_EQ(sent_at(0), 2);
  EXPECT_EQ(sent_at(5e-3), 2);
  EXPECT_NEAR(sent_at(7.5e-3), 1, 1e-9);
  EXPECT_EQ(sent_at(10e-3), 0);
  EXPECT_EQ(sent_at(1e9), 0);
  EXPECT_EQ(sent_at(-0.5e-3), 2) << "a clock that is set to ours may be a little ahead";
  for (const double no_age : {kNaN, kInfinity, -2e-3}) EXPECT_EQ(sent_at(no_age), 0) << no_age;
  // the force returns by the ramp
  Stage stage;
  stage.settle(Vector<World>(0, 2, 0));
  EXPECT_TRUE(stage.step({{Vector<World>(0, 2, 0), {}}, 1}).flags & kFlagStale);
  EXPECT_LT(stage.step(Vector<World>(0, 2, 0)).wrench.force_N.y(), 0.01);
}

// dropout: ticks without a fresh pose until `age_s`
Output drop_out(Stage& stage, const Vector<World>& requested, double age_s) {
  Output out;
  for (int n = 1; n <= std::lround(age_s / kTick_s); ++n) out = stage.step({{requested, {}}, n * kTick_s});
  return out;
}

TEST(OutputStage, ShortDropoutRecoversWithin50msWithoutAKick) {
  for (const double rest_N : {0.5, 1.0, 3.0, 8.0})
    for (const double dropout_s : {10e-3, 11e-3, 15e-3, 20e-3}) {
      SCOPED_TRACE(std::to_string(rest_N) + " N, " + std::to_string(dropout_s) + " s");
      Stage stage;
      stage.max_force_N = 8;
      const Vector<World> requested(0, rest_N, 0);
      stage.settle(requested);
      EXPECT_EQ(drop_out(stage, requested, dropout_s).wrench.force_N, Vector<World>());
      double before_N = 0;
      int ticks = 0;
      while (before_N < rest_N && ticks < 1000) {
        const double force_N = stage.step(requested).wrench.force_N.y();
        ASSERT_LE(force_N - before_N, 0.2);
        ASSERT_GT(force_N, before_N);
        before_N = force_N;
        ++ticks;
      }
      EXPECT_LE(ticks * kTick_s, 50e-3);
      // a decrease is not delayed
      const Vector<World> less(0, rest_N - 0.4, 0);
      EXPECT_EQ(stage.step(less).wrench.force_N, less);
      EXPECT_LE(stage.step(requested).wrench.force_N.y(), less.y() + 0.2);
      // after that time it is as fast as before
      for (int n = 0; n < 100; ++n) stage.step(less);
      EXPECT_EQ(stage.step(requested).wrench.force_N, requested);
    }
}

TEST(OutputStage, LongOrRepeatedDropoutRampsIn) {
  const Vector<World> requested(0, 2, 0);
  const auto comes_back = [&](Stage& stage) {
    for (int n = 1; n < 500; ++n)
      ASSERT_LE(stage.step(requested).wrench.force_N.y(), 2 * n * kTick_s / kOutputSettings.ramp_in_s + 1e-9)
          << n;
    EXPECT_NEAR(stage.step(requested).wrench.force_N.y(), 2, 1e-9);
  };
  {
    SCOPED_TRACE("a longer one");
    Stage stage;
    stage.settle(requested);
    drop_out(stage, requested, 21e-3);
    comes_back(stage);
  }
  for (const std::uint32_t fault :
       {kFlagNotFinite, kFlagJump, kFlagDeviceFault, kFlagHalted, kFlagEmergencyStop})
    for (const int when : {0, 12, 20}) {
      SCOPED_TRACE("fault " + std::to_string(fault) + " after " + std::to_string(when) +
                   " ticks without a pose");
      Stage stage;
      stage.settle(requested);
      drop_out(stage, requested, when * kTick_s);
      // including one that coincides with a stale pose
      stage.step({{requested, {}}, when == 12 ? 13e-3 : 0, fault});
      comes_back(stage);
    }
  for (const double no_age : {kNaN, kInfinity, -2e-3}) {
    SCOPED_TRACE("a pose of nobody knows when");
    Stage stage;
    stage.settle(requested);
    stage.step({{requested, {}}, no_age});
    comes_back(stage);
  }
  {
    SCOPED_TRACE("paused meanwhile");
    Stage stage;
    stage.settle(requested);
    drop_out(stage, requested, 11e-3);
    stage.step({{requested, {}}, 12e-3, 0, true});
    comes_back(stage);
  }
  {
    SCOPED_TRACE("a second one before half a second has gone well");
    Stage stage;
    stage.settle(requested);
    drop_out(stage, requested, 20e-3);
    for (int n = 0; n < 400; ++n) stage.step(requested);
    EXPECT_EQ(stage.state.sent.force_N, requested);
    drop_out(stage, requested, 11e-3);
    comes_back(stage);
  }
  {
    SCOPED_TRACE("one on the ramp");
    Stage stage;
    for (int n = 0; n < 250; ++n) stage.step(requested);
    drop_out(stage, requested, 11e-3);
    comes_back(stage);
  }
}

TEST(OutputStage, SlewLimitSpreadsAStepAndConverges) {
  Stage stage;
  stage.settle(Vector<World>(2, 0, 0));
  stage.limits.slew_N_per_s = 500;
  Output out;
  int ticks = 0;
  Vector<World> previous(2, 0, 0);
  do {
    out = stage.step(Vector<World>(-1, 2, 0));
    ASSERT_LE((out.wrench.force_N - previous).norm(), 0.5 * (1 + 1e-12));
    previous = out.wrench.force_N;
    ++ticks;
  } while (out.flags & kFlagSlew);
  EXPECT_EQ(out.wrench.force_N, Vector<World>(-1, 2, 0));
  EXPECT_EQ(ticks, static_cast<int>(std::ceil(std::hypot(3, 2) / 0.5)));
}

// motor model: tau h' = (F / continuous)^2 - h
TEST(OutputStage, ThermalBudgetLimitsToTheContinuousForce) {
  for (const double rate_hz : {1000.0, 10000.0}) {
    Stage stage;
    stage.limits = {8.5, 1.4, kNoValue, kNoValue};
    stage.max_force_N = 8.5;
    double excess_s = 0, previous_N = 0;
    for (int n = 0; n < 20 * rate_hz; ++n) {
      const Output out = stage.step(Vector<World>(0, 0, 20), 1 / rate_hz);
      const double force_N = out.wrench.force_N.norm();
      ASSERT_LE(stage.state.heat, 1);
      if (n > rate_hz) {
        ASSERT_LE(force_N, previous_N) << "the limit only sinks while everything is asked";
      }
      previous_N = force_N;
      excess_s += (force_N * force_N / (1.4 * 1.4) - 1) / rate_hz;
    }
    EXPECT_NEAR(previous_N, 1.4, 1e-3) << rate_hz;
    // excess work above the continuous rating is limited by the budget kOutputSettings.thermal_s, minus
    // cooling in the meantime
    EXPECT_LE(excess_s, kOutputSettings.thermal_s);
    EXPECT_GT(excess_s, 0.9 * kOutputSettings.thermal_s);
    // cooling at rest: after one time constant the heat is 1/e
    for (int n = 0; n < kOutputSettings.thermal_s * rate_hz; ++n) stage.step(Vector<World>(), 1 / rate_hz);
    EXPECT_NEAR(stage.state.heat, std::exp(-1), 1e-3);
  }
}

TEST(OutputStage, ContinuousForceIsNeverThermallyLimited) {
  Stage stage;
  stage.limits = {8.5, 1.4, kNoValue, kNoValue};
  for (int n = 0; n < 60000; ++n) {
    const Output out = stage.step(Vector<World>(0, 1.399, 0));
    ASSERT_EQ(out.flags & kFlagClamped, 0u) << n;
  }
}

double any_number(std::mt19937& random) {
  std::uniform_real_distribution<double> part(-1, 1), exponent(-320, 308);
  switch (random() % 12) {
    case 0:
      return kNaN;
    case 1:
      return random() % 2 ? kInfinity : -kInfinity;
    case 2:
      return part(random) * std::numeric_limits<double>::denorm_min() * 1000;
    case 3:
      return 0;
    case 4:
      return part(random) * std::pow(10, exponent(random));
    default:
      return 5 * part(random);
  }
}

Vector<World> any_vector(std::mt19937& random) {
  return {any_number(random), any_number(random), any_number(random)};
}

// long periods of ordinary ticks alternate with bursts of extreme ones
bool is_wild(int n) {
  return n % 4000 > 3800;
}

OutputRequest any_request(int n, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(0, 1);
  OutputRequest request;
  request.requested = {Vector<World>(6 * unit(random) - 3, 2, 4 * unit(random)),
                       Vector<World>(30 * unit(random), 0, 1), 2 * unit(random)};
  request.fade_out = random() % 20000 == 0;
  request.age_s = random() % 10 ? 0 : 0.006 * unit(random);
  if (!is_wild(n)) return request;
  if (random() % 2) request.requested = {any_vector(random), any_vector(random), any_number(random)};
  request.age_s = random() % 4 ? 0.02 * unit(random) : any_number(random);
  if (random() % 10 == 0) request.faults = kFlagEmergencyStop;
  return request;
}

// varying limits, invalid ones during the bursts
void change_limits(int n, std::mt19937& random, Stage& stage) {
  std::uniform_real_distribution<double> unit(0, 1);
  const auto limit = [&](double largest) {
    return is_wild(n) && random() % 3 == 0 ? any_number(random) : largest * unit(random);
  };
  if (random() % 300 == 0) stage.max_force_N = limit(10);
  if (random() % 1000 == 0) stage.limits = {limit(10), limit(4), limit(100), limit(8), limit(4000)};
}

TEST(OutputStage, MillionRandomInputsKeepAllInvariants) {
  const auto seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  const auto at_most = [](double limit) { return limit > 0 && std::isfinite(limit) ? limit : 0; };
  Stage stage;
  int silent = 0, near_limit = 0, slewed = 0, warm = 0;
  for (int n = 0; n < 1000000; ++n) {
    change_limits(n, random, stage);
    const OutputRequest request = any_request(n, random);
    const double dt_s = is_wild(n) && random() % 10 == 0 ? any_number(random) : kTick_s;

    const OutputState before = stage.state;
    const Output out = stage.step(request, dt_s);
    const double force_N = out.wrench.force_N.norm(), torque_Nmm = out.wrench.torque_Nmm.norm();
    ASSERT_TRUE(std::isfinite(force_N) && std::isfinite(torque_Nmm) && std::isfinite(out.wrench.gripper_N))
        << n;

    // never above a limit, including the thermal one
    ASSERT_LE(force_N, at_most(stage.max_force_N)) << n;
    if (!std::isnan(stage.limits.peak_force_N)) {
      ASSERT_LE(force_N, at_most(stage.limits.peak_force_N)) << n;
    }
    ASSERT_LE(force_N, out.limit_N) << n;
    ASSERT_LE(torque_Nmm, at_most(stage.limits.peak_torque_Nmm)) << n;
    ASSERT_LE(std::abs(out.wrench.gripper_N), at_most(stage.limits.peak_gripper_N)) << n;
    ASSERT_LE(stage.state.heat, 1) << n;

    // zero at once for faults and stale states, regardless of the slew
    const bool no_state =
        !(request.age_s >= -kOutputSettings.clock_jitter_s && request.age_s < kOutputSettings.stale_s);
    if (no_state || request.faults != 0 || (out.flags & kFaultFlags) != 0) {
      ASSERT_EQ(force_N, 0) << n;
      ++silent;
      continue;
    }
    near_limit += force_N > 0.5 * out.limit_N && out.limit_N > 0.1;
    warm += (out.flags & kFlagThermal) != 0;

    // growth, rotation and decrease of the force are limited by the slew; reductions by limits and age are
    // immediate
    const double path_N = (out.wrench.force_N - before.sent.force_N).norm();
    const double slew_N =
        (stage.limits.slew_N_per_s > 0 ? stage.limits.slew_N_per_s : OutputLimits{}.slew_N_per_s) * dt_s;
    const bool taken_away = before.sent.force_N.norm() > out.limit_N ||
                            request.age_s > kOutputSettings.fresh_s ||
                            before.sent.torque_Nmm.norm() > at_most(stage.limits.peak_torque_Nmm);
    if (dt_s == kTick_s && !taken_away) {
      ASSERT_LE(path_N, slew_N * (1 + 1e-9) + 1e-12) << n;
      slewed += (out.flags & kFlagSlew) != 0;
    }
  }
  // every event occurred often, and most ticks had a force
  EXPECT_GT(silent, 10000);
  EXPECT_GT(near_limit, 300000);
  EXPECT_GT(slewed, 1000);
  EXPECT_GT(warm, 10000);
}

TEST(OutputStage, ClampPreservesTheDirectionOfSlewLimitedForces) {
  const auto seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> component(-1, 1), exponent(-300, 300), limit(0.01, 40);
  Stage stage;
  stage.limits = {kNoValue, kNoValue, 1e-3, kNoValue, kInfinity};
  for (int i = 0; i < 1000000; ++i) {
    stage.state = {};
    stage.state.gain = 1;
    stage.max_force_N = limit(random);
    const Vector<World> direction(component(random), component(random), component(random));
    const Output out = stage.step(direction * std::pow(10, exponent(random)));
    ASSERT_LE(out.wrench.force_N.norm(), stage.max_force_N);
    if ((out.flags & kFlagClamped) == 0) continue;
    ASSERT_NEAR(out.wrench.force_N.norm(), stage.max_force_N, 1e-12 * stage.max_force_N);
    ASSERT_NEAR(out.wrench.force_N.normalized().dot(direction.normalized()), 1, 1e-12);
  }
}

}  // namespace
}  // namespace palpate
