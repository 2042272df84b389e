#include "palpate/contact/passivity.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "palpate/contact/contact_settings.h"
#include "palpate/device/telemetry.h"

namespace palpate {
namespace {

constexpr double kDt_s = 1e-3, kStep_mm = 0.03, kStiffness_N_per_mm = 1.5;
constexpr double kUnknown_mJ = std::numeric_limits<double>::infinity();

// a tip on a prescribed path, and the force sent there
struct Led {
  PassivityState state;
  Vector<World> sent_N;
  bool act = true;
  double true_mJ = 0;  // work of the force sent

  PassivityOutput advance(const Vector<World>& displacement_mm, const Vector<World>& force_N,
                          double stored_mJ = kUnknown_mJ) {
    true_mJ -= sent_N.dot(displacement_mm);
    const PassivityOutput out = control_passivity(
        {force_N, force_N.norm(), sent_N, displacement_mm, stored_mJ, kStiffness_N_per_mm, kStep_mm, kDt_s},
        act, state);
    sent_N = force_N * out.factor;
    return out;
  }
};

TEST(Passivity, ObserverIntegratesCommandedWork) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  const auto any = [&] { return Vector<World>(normal(random), normal(random), normal(random)); };
  Led guided;
  guided.act = false;
  for (int n = 0; n < 1000; ++n) EXPECT_EQ(guided.advance(any(), any()).factor, 1) << "observes only";
  EXPECT_NEAR(guided.state.energy_mJ, guided.true_mJ, 1e-9);
}

TEST(Passivity, SpringReturnsNoMoreThanItStored) {
  // into a wall and out again, sampled: without the controller each pass generates F v T
  for (const double speed_mm_s : {20.0, 50.0, 100.0, 200.0}) {
    SCOPED_TRACE(speed_mm_s);
    for (const bool act : {false, true}) {
      const double stride_mm = speed_mm_s * kDt_s;
      Led guided;
      guided.act = act;
      double x_mm = 0.5 * stride_mm;
      for (int press = 0; press < 10; ++press) {
        for (int n = 0; n < 60; ++n) {
          const double displacement_mm = n < 30 ? -stride_mm : stride_mm;
          x_mm += displacement_mm;
          guided.advance({displacement_mm, 0, 0}, {kStiffness_N_per_mm * std::max(0.0, -x_mm), 0, 0});
        }
      }
      const double once_mJ = 30 * stride_mm * kStiffness_N_per_mm * stride_mm;
      if (act)
        EXPECT_GT(guided.true_mJ, -0.5 * once_mJ) << "F v T of one press at most, on the turn";
      else
        EXPECT_LT(guided.true_mJ, -9 * once_mJ);
    }
  }
}

TEST(Passivity, DampsOnlyForcesAlongTheMotionAndNeverReversesThem) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  const auto any = [&] { return Vector<World>(normal(random), normal(random), normal(random)); };
  Led guided;
  int acted = 0;
  for (int n = 0; n < 10'000; ++n) {
    const Vector<World> displacement_mm = any() * 0.1, force_N = any();
    const PassivityOutput out = guided.advance(displacement_mm, force_N);
    EXPECT_GE(out.factor, 0);
    EXPECT_LE(out.factor, 1);
    EXPECT_LE(out.damping_N_s_per_m, kPassivitySettings.max_damping_N_s_per_m);
    EXPECT_TRUE(out.damping_N_s_per_m == 0 || out.factor < 1);
    acted += out.factor < 1;
    const bool against = displacement_mm.dot(force_N) < -2 * kStep_mm * force_N.norm();
    EXPECT_TRUE(out.factor == 1 || !against) << n;
  }
  EXPECT_GT(acted, 100);
}

TEST(Passivity, OneStepEncoderNoiseChangesTheForceByAtMostTwoSteps) {
  Led guided;
  for (int n = 0; n < 5000; ++n) {
    const bool inward = n % 2 == 0;
    const double force_N = inward ? 1 + kStiffness_N_per_mm * kStep_mm : 1;
    const PassivityOutput out = guided.advance({inward ? -kStep_mm : kStep_mm, 0, 0}, {force_N, 0, 0});
    EXPECT_EQ(out.damping_N_s_per_m, 0) << "no motion";
    if (inward)
      EXPECT_EQ(out.factor, 1) << n;
    else
      EXPECT_GE(force_N * out.factor, 1 - kStiffness_N_per_mm * kStep_mm - 1e-12) << n;
  }
}

TEST(Passivity, SlowSpringRecoversItsEnergyDeficit) {
  // in and out much more slowly than a velocity can be estimated, with a quantised position; forces act until
  // the next tick
  constexpr double kDeepest_mm = 0.5, kSpeed_mm_s = 2;
  for (const bool act : {false, true}) {
    SCOPED_TRACE(act);
    Led guided;
    guided.act = act;
    double true_mJ = 0, x_mm = 0.013, observed_mm = kStep_mm * std::floor(x_mm / kStep_mm);
    const int ticks = static_cast<int>(kDeepest_mm / (kSpeed_mm_s * kDt_s));
    for (int press = 0; press < 20; ++press)
      for (int n = 0; n < 2 * ticks; ++n) {
        const double displacement_mm = (n < ticks ? -1 : 1) * kSpeed_mm_s * kDt_s;
        x_mm += displacement_mm;
        true_mJ -= guided.sent_N.x() * displacement_mm;
        const double sees_mm = kStep_mm * std::floor(x_mm / kStep_mm);
        guided.advance({sees_mm - observed_mm, 0, 0}, {kStiffness_N_per_mm * std::max(0.0, -sees_mm), 0, 0});
        observed_mm = sees_mm;
      }
    const double once_mJ = kStiffness_N_per_mm * kDeepest_mm * kSpeed_mm_s * kDt_s;
    if (act)
      EXPECT_GT(true_mJ, 0);
    else
      EXPECT_LT(true_mJ, -10 * once_mJ);
  }
}

TEST(Passivity, DissipatedEnergyIsNoCredit) {
  // friction over a long distance, more than the spring stores
  Led guided;
  for (int n = 0; n < 1000; ++n) guided.advance({0, 0.1, 0}, {1, -0.3, 0}, 0.25);
  EXPECT_LE(guided.state.energy_mJ, 0.25);
  // in free space no energy is left
  guided.advance({0, 0.1, 0}, {}, 0);
  guided.advance({0, 0.1, 0}, {}, 0);
  EXPECT_EQ(guided.state.energy_mJ, 0);
}

TEST(Passivity, EnergyDeficitPersistsInFreeSpace) {
  Led guided;
  guided.act = false;
  guided.advance({}, {1, 0, 0});
  guided.advance({0.5, 0, 0}, {});
  for (int n = 0; n < 1000; ++n) guided.advance({0.1, 0, 0}, {});
  EXPECT_NEAR(guided.state.energy_mJ, -0.5, 1e-12);
}

TEST(Passivity, SlidingAroundABallIsPassive) {
  // a force rotating with the normal: one axis gives what the other takes, 1 N times the radius
  constexpr double kRadius_mm = 15, kForce_N = 1;
  Led guided;
  Vector<World> at(kRadius_mm, 0, 0);
  const double stride = 0.1 / kRadius_mm;
  for (int n = 1; n * stride < M_PI / 2; ++n) {
    const Vector<World> next = Vector<World>(std::cos(n * stride), std::sin(n * stride), 0) * kRadius_mm;
    EXPECT_GE(guided.advance(next - at, next * (kForce_N / kRadius_mm)).factor,
              1 - kStiffness_N_per_mm * kStep_mm / kForce_N - 1e-12);
    at = next;
  }
  EXPECT_NEAR(guided.state.energy_mJ, 0, 0.1) << "per axis it would be 15 mJ";
}

TEST(Passivity, StiffContactIsSoftenedWhileTheEnergyIsNegative) {
  constexpr double kStiff_N_per_mm = 20, kLimit_N = 0.9;
  constexpr double kStep_N = kStiff_N_per_mm * kStep_mm;
  const auto sent_N = [&](double energy_mJ, double stiffness_N_per_mm, double depth_mm) {
    PassivityState state;
    state.energy_mJ = energy_mJ;
    const double requested_N = stiffness_N_per_mm * depth_mm, force_N = std::min(requested_N, kLimit_N);
    return force_N *
           control_passivity(
               {{force_N, 0, 0}, requested_N, {}, {}, kUnknown_mJ, stiffness_N_per_mm, kStep_mm, kDt_s}, true,
               state)
               .factor;
  };
  EXPECT_NEAR(sent_N(0, kStiff_N_per_mm, kStep_mm), kStep_N, 1e-12) << "nothing is owed";
  EXPECT_NEAR(sent_N(-0.25 * kStep_N * kStep_mm, kStiff_N_per_mm, kStep_mm), 0.75 * kStep_N, 1e-12);
  for (const double owed_mJ : {0.1, 1.0, 100.0}) {
    EXPECT_NEAR(sent_N(-owed_mJ, kStiff_N_per_mm, kStep_mm), 0.15, 1e-12) << "never less";
    EXPECT_NEAR(sent_N(-owed_mJ, kStiff_N_per_mm, 4 * kStep_mm), 0.6, 1e-12) << "a spring";
    EXPECT_NEAR(sent_N(-owed_mJ, kStiff_N_per_mm, 8 * kStep_mm), kLimit_N, 1e-12) << "deep, all that may be";
    EXPECT_NEAR(sent_N(-owed_mJ, 0.15 / kStep_mm, kStep_mm), 0.15, 1e-12) << "soft already";
  }
}

TEST(Passivity, UnknownEncoderStepIsTreatedAsCoarse) {
  PassivityState known, unknown;
  const Vector<World> push(1, 0, 0);
  const PassivityInput input{push,        push.norm(),         push,     {0.08, 0, 0},
                             kUnknown_mJ, kStiffness_N_per_mm, kStep_mm, kDt_s};
  PassivityInput blind = input;
  blind.encoder_step_mm = kNoValue;
  EXPECT_GT(control_passivity(input, true, known).damping_N_s_per_m, 0) << "more than two steps";
  EXPECT_EQ(control_passivity(blind, true, unknown).damping_N_s_per_m, 0) << "perhaps one";
}

// A tip leaving fast, with a debt that would need more than the maximum damping.
TEST(Passivity, DampingFallsWithTheDelay) {
  for (const double rate_hz : {1000.0, 250.0})
    for (const double delay_s : {0.0, 1e-3, 4e-3}) {
      SCOPED_TRACE(std::to_string(rate_hz) + " Hz, " + std::to_string(delay_s) + " s");
      const double dt_s = 1 / rate_hz;
      const Vector<World> push(1, 0, 0);
      PassivityState state;
      PassivityInput input{push, push.norm(), push, {0.1, 0, 0}, kUnknown_mJ, 0.5, kStep_mm, dt_s};
      input.delay_s = delay_s;
      double damping_N_s_per_m = 0;
      for (int n = 0; n < 10; ++n)
        damping_N_s_per_m = control_passivity(input, true, state).damping_N_s_per_m;
      EXPECT_NEAR(damping_N_s_per_m,
                  std::min(kPassivitySettings.max_damping_N_s_per_m,
                           kPassivitySettings.max_damping_times_delay_kg / (delay_s + 0.5 * dt_s)),
                  1e-12);
    }
}

}  // namespace
}  // namespace palpate
