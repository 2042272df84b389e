#include "stability/buzz.h"

#include <gtest/gtest.h>

#include <cmath>

namespace palpate {
namespace {

using Places = std::vector<Eigen::Vector3d>;

Places none(std::size_t count) {
  return Places(count, Eigen::Vector3d::Zero());
}

TEST(Buzz, MeasuresASine) {
  for (const double rate_hz : {1000.0, 4000.0}) {
    Places tip_mm;
    for (int i = 0; i <= rate_hz; ++i)
      tip_mm.emplace_back(0, 3 + 0.2 * std::sin(2 * M_PI * 100 * i / rate_hz), 0);
    const Buzz buzz = buzz_of(tip_mm, none(tip_mm.size() - 1), rate_hz);
    EXPECT_NEAR(buzz.peak_to_peak_um, 400, 20) << "ten samples a period";
    EXPECT_NEAR(buzz.rms_um, 200 / std::sqrt(2.0), 0.1);
    EXPECT_EQ(buzz.dominant_Hz, 100);
    EXPECT_EQ(buzz.energy_mJ, 0);
  }
}

TEST(Buzz, ASlowOrFastSwingDominatesButIsNotInTheBand) {
  for (const double frequency_Hz : {8.0, 700.0}) {
    Places tip_mm;
    for (int i = 0; i <= 4000; ++i) tip_mm.emplace_back(std::sin(2 * M_PI * frequency_Hz / 4000 * i), 0, 0);
    const Buzz buzz = buzz_of(tip_mm, none(4000), 4000);
    EXPECT_EQ(buzz.dominant_Hz, frequency_Hz);
    EXPECT_LT(buzz.rms_um, 0.1);
  }
}

TEST(Buzz, EnergyIsForceTimesWay) {
  Places tip_mm;
  for (int i = 0; i <= 10; ++i) tip_mm.emplace_back(0.1 * i, -0.2 * i, 0);
  const Buzz buzz = buzz_of(tip_mm, Places(10, Eigen::Vector3d(2, 0.5, 9)), 1000);
  EXPECT_NEAR(buzz.energy_mJ, 2 * 1 - 0.5 * 2, 1e-12);
  EXPECT_NEAR(buzz.force_N, std::sqrt(4 + 0.25 + 81), 1e-12);
}

TEST(Buzz, ATipThatRestsHasNone) {
  const Buzz buzz = buzz_of(Places(101, Eigen::Vector3d(1, 2, 3)), none(100), 1000);
  EXPECT_EQ(buzz.peak_to_peak_um, 0);
  EXPECT_EQ(buzz.dominant_Hz, 0);
  EXPECT_EQ(buzz.rms_um, 0);
}

}  // namespace
}  // namespace palpate
