#include "session/session_statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "loading/test_loading.h"

namespace palpate {
namespace {

constexpr std::uint64_t kSeed = 20261120;

TickRecord tick_at(double time_s, double lateness_us, double compute_us = 5) {
  TickRecord record;
  record.time_s = time_s;
  record.dt_s = 1e-3;
  record.lateness_s = lateness_us * 1e-6;
  record.compute_s = compute_us * 1e-6;
  return record;
}

// quantile by nearest rank
double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size())));
  return values[std::max<std::size_t>(rank, 1) - 1];
}

TEST(SessionStatistics, LastSecondAgreesWithSortedTicks) {
  std::mt19937_64 random(kSeed);
  std::lognormal_distribution<double> lateness_us(2.5, 1.2);
  std::uniform_real_distribution<double> dt_s(0.2e-3, 8e-3);
  SessionStatistics statistics(*testing::loaded_ball().model, {});
  std::vector<TickRecord> ticks;
  double time_s = 0;
  for (int n = 0; n < 3000; ++n) {
    // an occasional stall of up to two seconds
    time_s += n % 501 == 500 ? 1e3 * dt_s(random) / 4 : dt_s(random);
    ticks.push_back(tick_at(time_s, lateness_us(random), lateness_us(random)));
    statistics.observe(ticks.back());
    if (n % 97 != 0) continue;

    // the ten tenths of a second that end with the latest tick's
    const double first_s = (std::floor(time_s * 10) - 9) / 10;
    std::vector<double> late, computed;
    for (const TickRecord& tick : ticks)
      if (tick.time_s >= first_s) {
        late.push_back(tick.lateness_s * 1e6);
        computed.push_back(tick.compute_s * 1e6);
      }
    const auto last = statistics.last_second();
    SCOPED_TRACE("seed " + std::to_string(kSeed) + ", tick " + std::to_string(n));
    // histogram buckets are 1.6 % wide, and times are whole nanoseconds
    const auto expect_close = [](double actual, double expected) {
      EXPECT_NEAR(actual, expected, 0.017 * expected + 0.002);
    };
    expect_close(last.lateness_p50_us, quantile(late, 0.5));
    expect_close(last.lateness_p99_us, quantile(late, 0.99));
    EXPECT_NEAR(last.lateness_max_us, quantile(late, 1), 0.001);
    expect_close(last.compute_p50_us, quantile(computed, 0.5));
  }
}

TEST(SessionStatistics, OneLateTickIsForgottenAfterASecond) {
  SessionStatistics statistics(*testing::loaded_ball().model, {});
  statistics.observe(tick_at(0, 900));
  for (int n = 1; n < 900; ++n) statistics.observe(tick_at(n * 1e-3, 10));
  EXPECT_DOUBLE_EQ(statistics.last_second().lateness_max_us, 900);
  for (int n = 900; n < 1100; ++n) statistics.observe(tick_at(n * 1e-3, 10));
  EXPECT_DOUBLE_EQ(statistics.last_second().lateness_max_us, 10);
}

TEST(SessionStatistics, IsEmptyWithoutTicks) {
  const SessionStatistics statistics(*testing::loaded_ball().model, {{testing::kBone, {}}});
  EXPECT_EQ(statistics.last_second().lateness_max_us, 0);
  EXPECT_EQ(statistics.max_force_N(), 0);
  ASSERT_EQ(statistics.holds().size(), 1u);
  EXPECT_EQ(statistics.holds()[0].structure, "ball");
  EXPECT_EQ(statistics.holds()[0].held_s, 0);
}

TEST(SessionStatistics, LargestForceIsOfAnyDeviceAndHoldsOfTheirStructure) {
  SessionStatistics statistics(*testing::loaded_ball().model,
                               {{testing::kBone, {1.0}}, {testing::kCartilage, {1.0, 2.0}}});
  for (int n = 0; n < 400; ++n) {
    TickRecord record = tick_at(n * 1e-3, 1);
    record.devices = 2;
    // target 1 N: within a fifth of it
    record.device[0].force_N = {0, 0.6, n == 40 ? 1.1 : 0.8};
    record.device[0].label = n < 300 ? testing::kBone : testing::kCartilage;
    record.device[1].force_N = {n == 7 ? 1.5 : 0.1, 0, 0};
    // device number 2 does not exist
    record.device[2].force_N = {9, 9, 9};
    statistics.observe(record);
  }
  EXPECT_DOUBLE_EQ(statistics.max_force_N(), 1.5);
  EXPECT_NEAR(statistics.holds()[0].held_s, 0.259, 1e-9) << "after the break";
  EXPECT_NEAR(statistics.holds()[0].mean_force_N, 1, 1e-3);
  EXPECT_NEAR(statistics.holds()[1].held_s, 0.1, 1e-9);
}

}  // namespace
}  // namespace palpate
