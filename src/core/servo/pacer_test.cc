#include "servo/pacer.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>
#include <tuple>

#include "palpate/base/clock.h"

namespace palpate {
namespace {

void busy_wait(std::int64_t ns) {
  for (const std::int64_t end = monotonic_ns() + ns; monotonic_ns() < end;) {
  }
}

// index, from the first tick's, of the grid point that a tick was for
std::int64_t grid_index(std::int64_t since_first_ns, double rate_hz) {
  return std::llround(static_cast<double>(since_first_ns) * rate_hz * 1e-9);
}

class PacerAt : public ::testing::TestWithParam<std::tuple<double, double>> {
 protected:
  const double rate_hz_ = std::get<0>(GetParam()), spin_s_ = std::get<1>(GetParam());
};

TEST_P(PacerAt, EveryScheduledTickRunsOrIsSkipped) {
  const std::atomic<bool> stop = false;
  Pacer pacer(rate_hz_, spin_s_, stop);
  const std::int64_t before_ns = monotonic_ns();
  std::int64_t first_ns = 0, last_ns = 0;
  std::uint64_t ticks = 0;
  while (last_ns < first_ns + 50'000'000) {
    ASSERT_TRUE(pacer.wait());
    const std::int64_t scheduled_ns = pacer.scheduled_ns();
    // never early
    ASSERT_GE(monotonic_ns(), scheduled_ns);
    if (ticks == 0) {
      first_ns = scheduled_ns;
      ASSERT_GE(first_ns, before_ns + pacer.period_ns()) << "the grid starts a period ahead";
    } else {
      ASSERT_GE(scheduled_ns - last_ns, pacer.period_ns() - 1);
    }
    last_ns = scheduled_ns;
    ++ticks;
    // exact on average: no drift, whatever the period
    const std::int64_t index = grid_index(last_ns - first_ns, rate_hz_);
    ASSERT_NEAR(static_cast<double>(last_ns - first_ns), static_cast<double>(index) * 1e9 / rate_hz_, 1.001);
    ASSERT_EQ(ticks + pacer.skipped(), static_cast<std::uint64_t>(index) + 1);
  }
}

TEST_P(PacerAt, StalledTicksAreSkipped) {
  const std::atomic<bool> stop = false;
  Pacer pacer(rate_hz_, spin_s_, stop);
  // a shared machine may delay this thread exactly when wait() reads the clock, which skips more points, but
  // not in every trial
  std::int64_t min_excess = 1000;
  for (int trial = 0; trial < 20 && min_excess > 1; ++trial) {
    ASSERT_TRUE(pacer.wait());
    const std::uint64_t skipped_before = pacer.skipped();
    const std::int64_t stalled_ns = pacer.scheduled_ns();
    busy_wait(25 * pacer.period_ns());
    const std::int64_t resumed_ns = monotonic_ns();
    ASSERT_TRUE(pacer.wait());
    const auto skipped = static_cast<std::int64_t>(pacer.skipped() - skipped_before);

    // exactly the points that passed: 25 unless the stall was longer
    const auto passed =
        static_cast<std::int64_t>(static_cast<double>(resumed_ns - stalled_ns) * rate_hz_ * 1e-9);
    ASSERT_GE(passed, 24);
    ASSERT_GE(skipped, passed);
    min_excess = std::min(min_excess, skipped - passed);
    ASSERT_GT(pacer.scheduled_ns(), resumed_ns);
    ASSERT_EQ(grid_index(pacer.scheduled_ns() - stalled_ns, rate_hz_), skipped + 1);

    // after that no two ticks within a period
    std::int64_t last_ns = pacer.scheduled_ns();
    for (int n = 0; n < 5; ++n) {
      ASSERT_TRUE(pacer.wait());
      const std::int64_t now_ns = monotonic_ns();
      ASSERT_GE(pacer.scheduled_ns() - last_ns, pacer.period_ns() - 1);
      ASSERT_GE(now_ns - last_ns, pacer.period_ns() - 1) << "a burst";
      last_ns = pacer.scheduled_ns();
    }
  }
  EXPECT_LE(min_excess, 1);
}

INSTANTIATE_TEST_SUITE_P(Rates, PacerAt,
                         ::testing::Combine(::testing::Values(1000.0, 2000.0, 3000.0, 4000.0, 8000.0,
                                                              10000.0),
                                            ::testing::Values(0.0, 80e-6)));

TEST(Pacer, StopsWithinAPeriodInsteadOfTicking) {
  std::atomic<bool> stop = false;
  // a period long enough that only the flag can end it, however late the other thread is
  Pacer pacer(1, 0, stop);
  EXPECT_FALSE(pacer.stopped());
  std::thread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    stop = true;
  });
  EXPECT_FALSE(pacer.wait());
  stopper.join();
  EXPECT_TRUE(pacer.stopped());
  const std::int64_t before_ns = monotonic_ns();
  for (int n = 0; n < 1000; ++n) ASSERT_FALSE(pacer.wait());
  EXPECT_LT(monotonic_ns() - before_ns, 1000 * pacer.period_ns()) << "it still waits";
}

TEST(Pacer, LongSpinTimeStillSleeps) {
  // each sleep is a voluntary context switch; spinning for a whole period would cause none
  const auto sleeps = [] {
    rusage usage{};
    ::getrusage(RUSAGE_THREAD, &usage);
    return usage.ru_nvcsw;
  };
  const std::atomic<bool> stop = false;
  Pacer pacer(200, 1, stop);
  const long before = sleeps();
  // if the machine is late there may be no time left to sleep in some of the waits
  for (int n = 0; n < 2000 && sleeps() - before < 5; ++n) ASSERT_TRUE(pacer.wait());
  EXPECT_GE(sleeps() - before, 5);
}

}  // namespace
}  // namespace palpate
