#include "palpate/stability/critical_stiffness.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>

#include "palpate/contact/model.h"
#include "palpate/contact/velocity.h"
#include "stability/critical_stiffness_hold.h"

namespace palpate {
namespace {

StabilityCase premium(double delay_s) {
  return {*find_plant_device("premium-1.5"), *find_plant_hand("light-grip"), 500, delay_s};
}

double critical(const StabilityCase& stability_case) {
  const auto found = critical_stiffness_N_per_mm(stability_case);
  EXPECT_TRUE(found.ok());
  return found ? *found : 0;
}

bool swings(const StabilityCase& stability_case, double stiffness_N_per_mm) {
  return has_limit_cycle(stability_case, stiffness_N_per_mm, 0.1) ||
         has_limit_cycle(stability_case, stiffness_N_per_mm, 0.5);
}

TEST(CriticalStiffness, FallsWithDelayAndGrowsWithTheRate) {
  EXPECT_FALSE(swings(premium(2e-3), 0.6));
  EXPECT_TRUE(swings(premium(6e-3), 0.6));

  StabilityCase fast = premium(1e-3);
  fast.rate_hz = 1000;
  EXPECT_TRUE(swings(premium(2e-3), 1.2));
  EXPECT_FALSE(swings(fast, 1.2));
}

TEST(CriticalStiffness, EqualsAnIndependentSimulation) {
  // stiffness in N/m at which a limit cycle first appeared in an independent simulation, in steps of 5 to 10
  // %
  const struct {
    const char *device, *hand;
    double delay_s, stiffness_N_per_m;
  } cases[] = {{"premium-1.5", "light-grip", 0, 7289},   {"premium-1.5", "light-grip", 1e-3, 1919},
               {"premium-1.5", "light-grip", 3e-3, 740}, {"premium-1.5", "firm-grip", 1e-3, 5476},
               {"premium-1.5", "firm-grip", 3e-3, 2111}, {"touch", "light-grip", 1e-3, 8820},
               {"touch", "light-grip", 3e-3, 2323}};
  for (const auto& one : cases) {
    const StabilityCase stability_case{*find_plant_device(one.device), *find_plant_hand(one.hand), 1000,
                                       one.delay_s};
    EXPECT_FALSE(swings(stability_case, 0.85e-3 * one.stiffness_N_per_m)) << one.stiffness_N_per_m;
    EXPECT_TRUE(swings(stability_case, 1.15e-3 * one.stiffness_N_per_m)) << one.stiffness_N_per_m;
  }
}

TEST(CriticalStiffness, TwiceTheLengthsGiveTwiceTheSwing) {
  // scaling: lengths, speeds and encoder steps doubled; masses, dampings and springs halved; equal forces
  const StabilityCase stability_case = premium(2e-3);
  StabilityCase doubled = stability_case;
  doubled.device.encoder_step_m *= 2;
  for (double* number : {&doubled.device.mass_kg, &doubled.device.damping_N_s_per_m, &doubled.hand.mass_kg,
                         &doubled.hand.damping_N_s_per_m, &doubled.hand.stiffness_N_per_m})
    *number /= 2;
  WallHold one(stability_case, 1.5, 0.1), other(doubled, 0.75, 0.2);
  for (int second = 0; second < 3; ++second) {
    const double swing_mm = one.next_amplitude_mm();
    EXPECT_GT(swing_mm, 0.1);
    EXPECT_NEAR(other.next_amplitude_mm(), 2 * swing_mm, 1e-6 * swing_mm);
  }
}

TEST(CriticalStiffness, WithoutFrictionALimitCycleAppearsAtTheTheoreticalStiffness) {
  // steps so fine that quantisation is negligible
  StabilityCase stability_case = premium(2e-3);
  stability_case.device.coulomb_N = 0;
  stability_case.device.encoder_step_m = 5e-6;
  const double theory = (stability_case.device.damping_N_s_per_m + stability_case.hand.damping_N_s_per_m) /
                        (0.5 / stability_case.rate_hz + stability_case.delay_s);
  EXPECT_FALSE(has_limit_cycle(stability_case, 0.85e-3 * theory, 0.1));
  EXPECT_TRUE(has_limit_cycle(stability_case, 1.15e-3 * theory, 0.1));
}

TEST(CriticalStiffness, SeparatesQuietHoldsFromLimitCycles) {
  const StabilityCase stability_case = premium(2e-3);
  const double stiffness = critical(stability_case);
  for (const double impact_m_s : {0.0, 0.1, 0.5}) {
    EXPECT_FALSE(has_limit_cycle(stability_case, stiffness, impact_m_s)) << impact_m_s;
    EXPECT_FALSE(has_limit_cycle(stability_case, 0.6 * stiffness, impact_m_s)) << impact_m_s;
  }
  EXPECT_TRUE(has_limit_cycle(stability_case, 1.3 * stiffness, 0.5));

  // a decaying oscillation may last longer than a second
  const auto settling = settling_stiffness_N_per_mm(stability_case);
  ASSERT_TRUE(settling.ok());
  EXPECT_LT(*settling, stiffness);
}

TEST(CriticalStiffness, AHoldStaysOnTheWallAtOneNewton) {
  // a hand of spring and damper comes to rest where both springs balance
  const StabilityCase stability_case = premium(0);
  WallHold hold(stability_case, 0.5, 0.1);
  for (int second = 0; second < 4; ++second) hold.next_amplitude_mm();
  EXPECT_LT(hold.next_amplitude_mm(), 1e-3);
  // friction may hold back 0.04 N of 1 N
  EXPECT_NEAR(hold.wall_force_N(), 1, 0.06);
}

TEST(CriticalStiffness, PassivityBoundIsTheLesserOfSamplingAndQuantisation) {
  const PlantDevice device = *find_plant_device("touch");
  EXPECT_NEAR(passivity_bound_N_per_mm(device, 1000), 0.2, 1e-12);
  EXPECT_NEAR(passivity_bound_N_per_mm(device, 1e6), 2 * 0.26 / 55e-6 * 1e-3, 1e-9);
  EXPECT_NEAR(passivity_bound_N_per_mm(*find_plant_device("premium-1.5"), 1000), 0.01, 1e-12);
}

TEST(CriticalStiffness, RecommendsAFractionOfTheMinimumOverGrips) {
  const PlantDevice device = *find_plant_device("premium-1.5");
  const auto recommended = recommended_stiffness_N_per_mm(device, 500, 2e-3);
  ASSERT_TRUE(recommended.ok());
  // the light pen grip decides
  StabilityCase pen = premium(2e-3);
  EXPECT_LT(*recommended, 0.6 * critical(pen));
  pen.hand = plant_hands_with_skin()[0];
  EXPECT_DOUBLE_EQ(*recommended, 0.6 * critical(pen));
  EXPECT_FALSE(swings({device, *find_plant_hand("firm-grip"), 500, 2e-3}, 2 * *recommended));
}

// growth of a bare mass's oscillation under a force opposing its windowed velocity: amplitude in the second
// half divided by that in the first
double growth_of_swing(double mass_kg, double damping_N_s_per_mm, double rate_hz, double delay_s) {
  const PlantDevice device{"bare", mass_kg, 0, 0, 0, 1e9, 1e9};
  SimulatedDevice plant(device, PlantHand{"none", 0, 0, 0}, delay_s);
  plant.reset(Point<Device>(0, 0, 0));
  VelocityWindow window;
  double before_mm = 0, early = 0, late = 0;
  const int ticks = static_cast<int>(rate_hz);
  for (int n = 0; n < 2 * ticks; ++n) {
    const double at_mm = plant.read().tip.x();
    window.push(Vector<Patient>(at_mm - before_mm, 0, 0), 1 / rate_hz);
    before_mm = at_mm;
    const double speed_mm_s = window.velocity_mm_s().x();
    // initial push
    const double force_N = n < ticks / 100 ? 1 : -damping_N_s_per_mm * speed_mm_s;
    plant.advance({Vector<Device>(force_N, 0, 0), {}}, 1 / rate_hz);
    double& largest = n < ticks ? early : late;
    if (n > ticks / 2) largest = std::max(largest, std::abs(plant.true_velocity_mm_s().x()));
  }
  return late / early;
}

TEST(CriticalStiffness, TheSameLoopIsRecommendedTheSameStiffnessWithoutAnotherSearch) {
  PlantDevice device = *find_plant_device("touch");
  const auto first = recommended_stiffness_N_per_mm(device, 900, 0);
  ASSERT_TRUE(first);
  // a search that is interrupted at once returns an error
  const std::atomic<bool> stop = true;
  const Progress stopped({}, &stop);
  const auto again = recommended_stiffness_N_per_mm(device, 900, 0, stopped);
  ASSERT_TRUE(again);
  EXPECT_EQ(*again, *first);
  device.encoder_step_m *= 2;
  EXPECT_FALSE(recommended_stiffness_N_per_mm(device, 900, 0, stopped)) << "another device";
  device.encoder_step_m /= 2;
  EXPECT_FALSE(recommended_stiffness_N_per_mm(device, 901, 0, stopped)) << "another rate";
  EXPECT_FALSE(recommended_stiffness_N_per_mm(device, 900, 1e-3, stopped)) << "another delay";
}

TEST(CriticalStiffness, ABareMassSwingsFromTheTheoreticalDampingOn) {
  for (const double rate_hz : {500.0, 1000.0, 10000.0})
    for (const double delay_s : {0.0, 1e-3, 3e-3})
      for (const double mass_kg : {0.045, 0.2}) {
        SCOPED_TRACE(std::to_string(rate_hz) + " Hz, " + std::to_string(delay_s) + " s");
        const double neutral = neutral_damping_N_s_per_mm(mass_kg, rate_hz, delay_s);
        EXPECT_LT(growth_of_swing(mass_kg, 0.92 * neutral, rate_hz, delay_s), 1);
        EXPECT_GT(growth_of_swing(mass_kg, 1.08 * neutral, rate_hz, delay_s), 1);
      }
}

TEST(CriticalStiffness, RecommendsAFractionOfTheStableDamping) {
  const PlantDevice premium = *find_plant_device("premium-1.5"), touch = *find_plant_device("touch");
  EXPECT_DOUBLE_EQ(recommended_damping_N_s_per_mm(premium, 1000, 1e-3),
                   kStiffnessMargin * neutral_damping_N_s_per_mm(premium.mass_kg, 1000, 1e-3));
  EXPECT_NEAR(recommended_damping_N_s_per_mm(premium, 1000, 1e-3), 0.0141, 1e-4);
  EXPECT_LT(recommended_damping_N_s_per_mm(touch, 1000, 1e-3),
            recommended_damping_N_s_per_mm(touch, 1000, 0));
  EXPECT_LT(recommended_damping_N_s_per_mm(touch, 250, 1e-3),
            recommended_damping_N_s_per_mm(touch, 1000, 1e-3));
}

TEST(CriticalStiffness, RejectsUnstableSettings) {
  StabilityCase slow = premium(0), late = premium(1), limp = premium(0), smooth = premium(0),
                light = premium(0);
  slow.rate_hz = std::nan("");
  limp.hand.stiffness_N_per_m = 0;
  smooth.device.encoder_step_m = 0;
  light.hand.mass_kg = light.device.mass_kg = 0;
  for (const StabilityCase& stability_case : {slow, late, limp, smooth, light}) {
    const auto refused = critical_stiffness_N_per_mm(stability_case);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
  }
}

TEST(CriticalStiffness, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto found =
      recommended_stiffness_N_per_mm(*find_plant_device("touch"), 1000, 1e-3, Progress({}, &stop));
  ASSERT_FALSE(found.ok());
  EXPECT_EQ(found.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
