#include "report/loop_figures.h"
#include "palpate/recording/recording_source.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace palpate::report {
namespace {

Spread spread_of(const std::vector<double>& values_s) {
  SpreadMeter meter;
  for (const double value : values_s) meter.add(value);
  return meter.spread();
}

double measured_rate_hz(const Recording& recording) {
  TickRateMeter rate;
  TickTimes times(RecordingSource(recording).head());
  const auto observe = [&](const TimedTick& now) { rate.observe(now); };
  times.take(recording.ticks, observe);
  times.finish(observe);
  return rate.rate_hz();
}

TEST(Spread, IsOfNearestRanks) {
  std::vector<double> values;
  for (int i = 1000; i >= 1; --i) values.push_back(i);
  const Spread spread = spread_of(values);
  EXPECT_EQ(spread.p50_s, 500);
  EXPECT_EQ(spread.p99_s, 990);
  EXPECT_EQ(spread.p999_s, 999);
  EXPECT_EQ(spread.max_s, 1000);
  EXPECT_EQ(spread_of({7}).p50_s, 7);
  EXPECT_EQ(spread_of({7}).p999_s, 7);
}

TEST(Spread, HoldsByItsDefinition) {
  std::mt19937_64 random(20260301);
  SCOPED_TRACE("seed 20260301");
  for (int round = 0; round < 200; ++round) {
    std::vector<double> values(1 + random() % 3000);
    for (double& value : values) value = static_cast<double>(random() % 50);  // many are equal
    const Spread spread = spread_of(values);
    const auto part_up_to = [&](double bound) {
      return static_cast<double>(std::ranges::count_if(values, [&](double v) { return v <= bound; })) /
             static_cast<double>(values.size());
    };
    for (const auto& [part, value] :
         {std::pair{0.5, spread.p50_s}, {0.99, spread.p99_s}, {0.999, spread.p999_s}}) {
      EXPECT_GE(part_up_to(value), part);
      EXPECT_LT(part_up_to(value - 1), part);
    }
    EXPECT_EQ(spread.max_s, *std::ranges::max_element(values));
  }
}

TEST(Spread, IsNeverTooSmallAndTooLargeByAPartIn4096) {
  std::mt19937_64 random(20260302);
  SCOPED_TRACE("seed 20260302");
  std::lognormal_distribution<double> late(-11, 1.5);
  std::vector<double> values(50'000);
  for (double& value : values) value = late(random);
  const Spread spread = spread_of(values);
  std::ranges::sort(values);
  for (const auto& [rank, value] : {std::pair{25'000, spread.p50_s},
                                    {49'500, spread.p99_s},
                                    {49'950, spread.p999_s},
                                    {50'000, spread.max_s}}) {
    EXPECT_GE(value, values[static_cast<std::size_t>(rank) - 1]);
    EXPECT_LE(value, values[static_cast<std::size_t>(rank) - 1] * (1 + 1.0 / 4096));
  }
  EXPECT_EQ(spread.max_s, values.back());
}

TEST(Spread, SkipsNaN) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const Spread spread = spread_of({kNan, 3, std::numeric_limits<double>::infinity(), 1, kNan});
  EXPECT_EQ(spread.p50_s, 1);
  EXPECT_EQ(spread.max_s, 3);
  EXPECT_TRUE(std::isnan(spread_of({kNan}).max_s));
  EXPECT_TRUE(std::isnan(spread_of({}).p50_s));
}

TEST(MeasuredRate, CountsTicksThatWereDropped) {
  Recording recording;
  for (std::uint64_t i = 0; i < 100; ++i) {
    TickRecord tick;
    // 500 Hz; every other tick of the second half is missing
    tick.tick = i < 50 ? i : 2 * i - 50;
    tick.time_s = 2e-3 * static_cast<double>(tick.tick);
    recording.ticks.push_back(tick);
  }
  EXPECT_NEAR(measured_rate_hz(recording), 500, 1e-6);
  recording.ticks.resize(1);
  EXPECT_TRUE(std::isnan(measured_rate_hz(recording)));
}

}  // namespace
}  // namespace palpate::report
