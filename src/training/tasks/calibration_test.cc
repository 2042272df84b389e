#include "palpate/tasks/calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace palpate {
namespace {

using ::testing::HasSubstr;

std::vector<double> normal_sample(std::uint64_t seed, double mean, double sd, int count) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(mean, sd);
  std::vector<double> values;
  for (int n = 0; n < count; ++n) values.push_back(normal(random));
  return values;
}

TEST(AreaUnderCurve, IsTheShareOfPairsInOrder) {
  const std::vector<double> good{1, 2, 3}, bad{2, 4};
  // pairs: 2>1, 2=2, 2<3, 4>1, 4>2, 4>3
  EXPECT_DOUBLE_EQ(area_under_curve(good, bad, false), 4.5 / 6);
  EXPECT_DOUBLE_EQ(area_under_curve(good, bad, true), 1.5 / 6);
  EXPECT_DOUBLE_EQ(area_under_curve(good, good, false), 0.5);
  EXPECT_TRUE(std::isnan(area_under_curve({}, bad, false)));
  const std::vector<double> none{std::numeric_limits<double>::quiet_NaN()};
  EXPECT_DOUBLE_EQ(area_under_curve(good, none, true), 1);
}

TEST(CutOff, ExpertCutOffIsAQuantile) {
  std::vector<double> values;
  for (int n = 0; n <= 100; ++n) values.push_back(n);
  const auto most = cut_off(values, {}, false);
  ASSERT_TRUE(most.ok());
  EXPECT_NEAR(most->value, 90, 1e-9);
  EXPECT_NEAR(cut_off(values, {}, true)->value, 10, 1e-9);
  EXPECT_LT(most->interval[0], 90);
  EXPECT_GT(most->interval[1], 90);
  EXPECT_TRUE(most->has_enough_runs);
  // the same seed gives the same interval
  EXPECT_EQ(cut_off(values, {}, false)->interval, most->interval);
}

TEST(CutOff, OfContrastingGroupsIsWhereTheirDensitiesCross) {
  // equal spreads: the midpoint
  const auto good = normal_sample(1, 10, 1, 4000), bad = normal_sample(2, 16, 1, 4000);
  const auto found = cut_off(good, bad, false);
  ASSERT_TRUE(found.ok());
  EXPECT_NEAR(found->value, 13, 0.05);
  EXPECT_LT(*found->experts_below, 0.01);
  EXPECT_LT(*found->novices_above, 0.01);
  // unequal spreads, N(0, 1) and N(6, 3): closer to the narrow one, where (x-6)^2/9 - x^2 + 2 ln 3 = 0
  const auto narrow = normal_sample(3, 0, 1, 20000), wide = normal_sample(4, 6, 3, 20000);
  const double crossing = (-12 + std::sqrt(144 + 32 * (36 + 18 * std::log(3.0)))) / 16;
  EXPECT_NEAR(cut_off(narrow, wide, false)->value, crossing, 0.05);
}

TEST(CutOff, ItsIntervalHoldsTheTruthAboutNineteenTimesInTwenty) {
  int covered = 0;
  constexpr int kTimes = 200;
  for (int n = 0; n < kTimes; ++n) {
    CalibrationOptions options;
    options.fraction = 0.5;
    options.resamples = 400;
    options.seed = static_cast<std::uint64_t>(n);
    const auto found =
        cut_off(normal_sample(100 + static_cast<std::uint64_t>(n), 5, 2, 40), {}, false, options);
    covered += found->interval[0] <= 5 && 5 <= found->interval[1];
  }
  EXPECT_GE(covered, kTimes * 0.88);
  EXPECT_LE(covered, kTimes * 0.99);
}

TEST(CutOff, ReportsMissingCutOffs) {
  const std::vector<double> two{1, 2}, five{1, 2, 3, 4, 5}, higher{11, 12, 13};
  EXPECT_FALSE(cut_off(two, {}, false).ok());
  EXPECT_FALSE(cut_off(five, two, false).ok());
  const std::vector<double> unknown{1, 2, std::numeric_limits<double>::quiet_NaN()};
  EXPECT_THAT(cut_off(unknown, {}, false).error().what, HasSubstr("no value"));
  EXPECT_THAT(cut_off(higher, five, false).error().what, HasSubstr("no worse"));
  EXPECT_FALSE(cut_off(five, {}, false)->has_enough_runs);
  // groups without spread
  const std::vector<double> same{3, 3, 3}, others{4, 4, 4};
  EXPECT_EQ(cut_off(same, others, false)->value, 3.5);
}

}  // namespace
}  // namespace palpate
