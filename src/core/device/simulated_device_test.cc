#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "palpate/device/simulated_device.h"

namespace palpate {
namespace {

constexpr double kTick_s = 1e-3;
const PlantDevice kIdeal{"ideal", 0.05, 0, 0, 0, 1e9, 1e9};

TEST(SimulatedDevice, OscillatesAsADampedOscillator) {
  // m x'' + b x' + k x = 0 from 10 mm, compared with the closed-form solution
  const PlantHand hand{"hand", 0.15, 2, 80};
  SimulatedDevice plant(kIdeal, hand);
  plant.reset(Point<Device>(10, 0, 0));
  plant.intend(Point<Device>(0, 0, 0));
  // the first advance moves the intended position there; reset so that it is there from the start
  plant.advance({}, 1e-9);
  const double m = 0.2, b = 2, k = 80;
  const double decay = b / (2 * m), omega = std::sqrt(k / m - decay * decay);
  double largest = 0;
  for (int n = 1; n <= 500; ++n) {
    plant.advance({}, kTick_s);
    const double t = n * kTick_s;
    // the jump of the intended position acted once through the damper: x'(0) = -b/m * 10 mm
    const double x0 = 10, v0 = -b / m * 10;
    const double expected =
        std::exp(-decay * t) * (x0 * std::cos(omega * t) + (v0 + decay * x0) / omega * std::sin(omega * t));
    largest = std::max(largest, std::abs(plant.true_tip().x() - expected));
  }
  EXPECT_LT(largest, 0.01);
}

// Two springs in series: hand and skin.
TEST(SimulatedDevice, SkinYieldsBeforeTheHandDoes) {
  const double force_N = 1;
  SimulatedDevice plant(kIdeal, PlantHand{"pen", 0.15, 6, 500, 2000, 20});
  plant.reset(Point<Device>(0, 0, 0));
  double work_mJ = 0;
  for (int n = 0; n < 3000; ++n) {
    plant.advance({Vector<Device>(force_N, 0, 0), {}}, kTick_s);
    work_mJ += plant.work_mJ();
  }
  EXPECT_NEAR(plant.true_tip().x(), 1e3 * force_N * (1 / 500.0 + 1 / 2000.0), 1e-6);
  EXPECT_NEAR(work_mJ, force_N * plant.true_tip().x(), 1e-9) << "N mm are mJ";
}

TEST(SimulatedDevice, BehindRigidSkinDeviceAndHandAreOneMass) {
  SimulatedDevice one(kIdeal, PlantHand{"hand", 0.15, 2, 80});
  SimulatedDevice two(kIdeal, PlantHand{"hand", 0.15, 2, 80, 1e6, 100});
  for (SimulatedDevice* plant : {&one, &two}) plant->reset(Point<Device>(0, 0, 0));
  double farthest_mm = 0, largest_mm = 0;
  for (int n = 0; n < 1000; ++n) {
    for (SimulatedDevice* plant : {&one, &two}) {
      plant->intend(Point<Device>(10 * std::sin(0.02 * n), 0, 0));
      plant->advance({}, kTick_s);
    }
    farthest_mm = std::max(farthest_mm, (one.true_tip() - two.true_tip()).norm());
    largest_mm = std::max(largest_mm, one.true_tip().x());
  }
  EXPECT_GT(largest_mm, 5);
  EXPECT_LT(farthest_mm, 0.02);
}

TEST(SimulatedDevice, NeverGainsEnergyWithoutAForce) {
  const PlantHand hand{"hand", 0.15, 0.5, 80};
  SimulatedDevice plant(kIdeal, hand);
  plant.reset(Point<Device>(0, 0, 0));
  plant.intend(Point<Device>(8, -3, 2));
  plant.advance({}, kTick_s);
  const auto energy = [&] {
    const double stretch = (Point<Device>(8, -3, 2) - plant.true_tip()).norm() * 1e-3;
    const double speed = plant.true_velocity_mm_s().norm() * 1e-3;
    return 0.5 * 80 * stretch * stretch + 0.5 * 0.2 * speed * speed;
  };
  double before = energy();
  for (int n = 0; n < 2000; ++n) {
    plant.advance({}, kTick_s);
    const double now = energy();
    // semi-implicit Euler conserves energy to the order of its step
    ASSERT_LE(now, before * (1 + 1e-3) + 1e-12) << n;
    before = now;
  }
  EXPECT_LT(before, 3.2e-3 * std::exp(-0.5 / 0.2 * 2) * 1.1) << "decays by b/m";
}

TEST(SimulatedDevice, SticksBelowCoulombAndSlipsAbove) {
  const PlantDevice sticky{"sticky", 0.05, 0, 0.2, 0, 1e9, 1e9};
  const PlantHand free_hand{"free", 0.1, 0, 0};
  SimulatedDevice plant(sticky, free_hand);
  plant.reset(Point<Device>(1, 2, 3));
  for (int n = 0; n < 100; ++n) plant.advance({Vector<Device>(0.12, 0.15, 0), {}}, kTick_s);  // 0.192 N
  EXPECT_EQ(plant.true_tip(), Point<Device>(1, 2, 3));
  for (int n = 0; n < 100; ++n) plant.advance({Vector<Device>(0.15, 0.15, 0), {}}, kTick_s);  // 0.212 N
  EXPECT_GT(plant.true_tip().x(), 1);
}

TEST(SimulatedDevice, EncoderFloorsToWholeSteps) {
  SimulatedDevice plant(*find_plant_device("premium-1.5"), *find_plant_hand("light-grip"));
  plant.reset(Point<Device>(0.0449, -0.0001, 0));
  const Point<Device> read = plant.read().tip;
  EXPECT_NEAR(read.x(), 0.030, 1e-9);
  EXPECT_NEAR(read.y(), -0.030, 1e-9);
  EXPECT_NEAR(read.z(), 0, 1e-12);
}

TEST(SimulatedDevice, DelaysTheForceAndSaturatesIt) {
  const PlantDevice weak{"weak", 0.05, 0, 0, 0, 2, 1};
  const PlantHand free_hand{"free", 0.05, 0, 0};
  SimulatedDevice plant(weak, free_hand, 3e-3);
  plant.reset(Point<Device>());
  for (int n = 0; n < 3; ++n) plant.advance({Vector<Device>(0, 50, 0), {}}, kTick_s);
  EXPECT_EQ(plant.true_tip(), Point<Device>()) << "nothing may act before the delay";
  plant.advance({Vector<Device>(0, 50, 0), {}}, kTick_s);
  // 2 N on 0.1 kg for 1 ms: 20 mm/s
  EXPECT_NEAR(plant.true_velocity_mm_s().y(), 20, 1e-9);
}

TEST(SimulatedDevice, WallTurnsUnstableAtTheTheoreticalStiffness) {
  // Colgate & Schenkel: a mass with damping b on a sampled bilateral spring is stable up to b / (T/2 + t_d)
  for (const double delay_s : {0.0, 1e-3, 3e-3}) {
    const double b = 1.5;
    const double critical_N_per_m = b / (kTick_s / 2 + delay_s);
    const auto final_swing = [&](double stiffness_N_per_m) {
      const PlantHand hand{"hand", 0.3, b, 0};
      SimulatedDevice plant(kIdeal, hand, delay_s);
      plant.reset(Point<Device>(1, 0, 0));
      double swing = 0;
      for (int n = 0; n < 20000; ++n) {
        const double x_mm = plant.read().tip.x();
        plant.advance({Vector<Device>(-stiffness_N_per_m * 1e-3 * x_mm, 0, 0), {}}, kTick_s);
        if (n > 19000) swing = std::max(swing, std::abs(x_mm));
      }
      return swing;
    };
    EXPECT_LT(final_swing(0.95 * critical_N_per_m), 1) << "delay " << delay_s;
    EXPECT_GT(final_swing(1.05 * critical_N_per_m), 1) << "delay " << delay_s;
  }
}

TEST(SimulatedDevice, IsDeterministic) {
  const auto run = [] {
    SimulatedDevice plant(*find_plant_device("touch"), *find_plant_hand("firm-grip"), 1e-3);
    plant.reset(Point<Device>(1, 2, 3));
    for (int n = 0; n < 300; ++n) {
      plant.intend(Point<Device>(1 + 0.01 * n, 2, 3 - 0.02 * n));
      plant.advance({Vector<Device>(-0.1 * plant.read().tip.x(), 0, 0.3), {}}, kTick_s);
    }
    return plant.true_tip();
  };
  EXPECT_EQ(run(), run());
}

TEST(SimulatedDevice, UnusableInputsLeaveItsStateFinite) {
  const double no_number = std::numeric_limits<double>::quiet_NaN();
  SimulatedDevice plant(*find_plant_device("touch"), *find_plant_hand("firm-grip"), no_number);
  plant.reset(Point<Device>(1, 2, 3));
  plant.advance({Vector<Device>(1, 0, 0), {}}, kTick_s);
  const Point<Device> before = plant.true_tip();
  for (const double dt_s : {0.0, -1e-3, no_number, HUGE_VAL, 1e9}) {
    plant.advance({Vector<Device>(1, 0, 0), {}}, dt_s);
    EXPECT_EQ(plant.true_tip(), before) << dt_s;
    EXPECT_EQ(plant.work_mJ(), 0) << dt_s;
  }
  plant.intend(Point<Device>(no_number, 0, 0));
  EXPECT_EQ(plant.intention(), Point<Device>(1, 2, 3));
  plant.reset(Point<Device>(0, HUGE_VAL, 0));
  EXPECT_EQ(plant.true_tip(), before);
  plant.advance({Vector<Device>(no_number, 0, 0), {}}, kTick_s);
  EXPECT_TRUE(plant.true_tip().all_finite());

  SimulatedDevice late(kIdeal, *find_plant_hand("firm-grip"), 1e9);
  late.advance({Vector<Device>(1, 0, 0), {}}, SimulatedDevice::kMaxDelay_s);
  EXPECT_EQ(late.true_tip(), Point<Device>()) << "a delay above the maximum counts as the maximum";
}

TEST(SimulatedDevice, UnknownNamesListTheKnownOnes) {
  const auto device = find_plant_device("omega");
  ASSERT_FALSE(device.ok());
  EXPECT_NE(device.error().remedy.find("premium-1.5, touch"), std::string::npos);
  EXPECT_FALSE(find_plant_hand("iron").ok());
}

}  // namespace
}  // namespace palpate
