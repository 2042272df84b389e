#include "verification/stability_buzz.h"

#include <gtest/gtest.h>

#include <cmath>

namespace palpate {
namespace {

TEST(Buzz, OfASineIsItsAmplitudeFrequencyAndRms) {
  std::vector<Eigen::Vector3d> tip_mm;
  for (int i = 0; i <= 1000; ++i) tip_mm.emplace_back(0, 3 + 0.2 * std::sin(2 * M_PI * 0.1 * i), 0);
  const std::vector<Eigen::Vector3d> none(1000, Eigen::Vector3d::Zero());
  const Buzz buzz = buzz_of(tip_mm, none);
  EXPECT_NEAR(buzz.peak_to_peak_um, 400, 20) << "ten samples a period";
  EXPECT_NEAR(buzz.rms_um, 200 / std::sqrt(2.0), 0.1);
  EXPECT_EQ(buzz.dominant_Hz, 100);
  EXPECT_EQ(buzz.energy_mJ, 0);
}

TEST(Buzz, ASlowSwingDominatesButIsNotInTheBand) {
  std::vector<Eigen::Vector3d> tip_mm;
  for (int i = 0; i <= 1000; ++i) tip_mm.emplace_back(std::sin(2 * M_PI * 0.008 * i), 0, 0);
  const Buzz buzz = buzz_of(tip_mm, std::vector<Eigen::Vector3d>(1000, Eigen::Vector3d::Zero()));
  EXPECT_EQ(buzz.dominant_Hz, 8);
  EXPECT_LT(buzz.rms_um, 0.1);
}

TEST(Buzz, EnergyIsForceTimesWay) {
  std::vector<Eigen::Vector3d> tip_mm;
  for (int i = 0; i <= 10; ++i) tip_mm.emplace_back(0.1 * i, -0.2 * i, 0);
  const Buzz buzz = buzz_of(tip_mm, std::vector<Eigen::Vector3d>(10, Eigen::Vector3d(2, 0.5, 9)));
  EXPECT_NEAR(buzz.energy_mJ, 2 * 1 - 0.5 * 2, 1e-12);
}

TEST(Buzz, AHandInFreeSpaceStandsStill) {
  const auto model = two_plates(1);
  ASSERT_TRUE(model.ok()) << model.error().message();
  const Buzz buzz =
      hold_still(**model, ForceMethod::kTrilinear, *find_plant_device("premium-1.5"),
                 *find_plant_hand("light-grip"), {Point<Patient>(23, 0, 0), Point<Patient>(23, 0, 0)});
  EXPECT_EQ(buzz.peak_to_peak_um, 0);
  EXPECT_EQ(buzz.energy_mJ, 0);
}

TEST(Buzz, AWallIsHeldQuietlyAtOneNewton) {
  const auto model = two_plates(1);
  ASSERT_TRUE(model.ok());
  const PlantHand hand = *find_plant_hand("firm-grip");
  // 1 N of 1 N/mm * 1.5 mm * sqrt(2 pi) is what Phi(-0.626) is; then the hand's spring, 2 mm
  const Point<Patient> pressed(16.5 + 0.626 * 1.5 - 2, 0, 0);
  const Buzz buzz = hold_still(**model, ForceMethod::kTrilinear, *find_plant_device("premium-1.5"), hand,
                               {Point<Patient>(19, 0, 0), pressed});
  EXPECT_LE(buzz.peak_to_peak_um, 2 * 30);
  EXPECT_NEAR(buzz.force_N, 1, 0.1);
}

TEST(Buzz, BetweenTwoPlatesAWideUnionGivesOutEnergy) {
  // smoothed wider than their gap, it pushes from side to side: the founding fault
  const auto model = two_plates(1);
  ASSERT_TRUE(model.ok());
  const Buzz buzz =
      hold_still(**model, ForceMethod::kTrilinear, *find_plant_device("premium-1.5"),
                 *find_plant_hand("light-grip"), {Point<Patient>(0.2, 0, 0), Point<Patient>(0.2, 0, 0)});
  EXPECT_GT(buzz.peak_to_peak_um, 2 * 30);
  EXPECT_GT(buzz.energy_mJ, 0);
}

}  // namespace
}  // namespace palpate
