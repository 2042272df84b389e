#include "palpate/servo/empty_loop.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "base/test_processors.h"

namespace palpate {
namespace {

TEST(EmptyLoop, MeasuresEveryScheduledTick) {
  LatencyHistogram lateness;
  const auto loop = measure_empty_loop(2000, 0.2, 50e-6, {.lock_memory = false}, lateness);
  ASSERT_TRUE(loop.ok()) << loop.error().message();
  // more only if the last points were skipped
  EXPECT_GE(loop->ticks + loop->skipped, 400u);
  EXPECT_LE(loop->ticks, 400u);
  EXPECT_GT(loop->ticks, 0u);
  EXPECT_EQ(lateness.summary().n, loop->ticks);
  EXPECT_GT(lateness.summary().max_us, 0);
  EXPECT_FALSE(loop->grant.scheduler.empty());
  EXPECT_FALSE(loop->grant.memory_locked);
}

TEST(EmptyLoop, StopsWhenAsked) {
  std::atomic<bool> stop = false;
  LatencyHistogram lateness;
  std::thread stopper([&] {
    while (lateness.summary().n < 3) std::this_thread::yield();
    stop = true;
  });
  const auto loop =
      measure_empty_loop(1000, 3600, 0, {.fifo = false, .lock_memory = false}, lateness, Progress({}, &stop));
  stopper.join();
  ASSERT_FALSE(loop.ok());
  EXPECT_EQ(loop.error().kind, ErrorKind::kInterrupted);
  EXPECT_GE(lateness.summary().n, 3u);
  EXPECT_LT(lateness.summary().n, 3'600'000u);
}

TEST(EmptyLoop, ReportsThreadCreationFailure) {
  const test::NoThreads none;
  LatencyHistogram lateness;
  const auto loop = measure_empty_loop(1000, 0.1, 0, {.fifo = false, .lock_memory = false}, lateness);
  ASSERT_FALSE(loop.ok());
  EXPECT_EQ(loop.error().kind, ErrorKind::kUnavailable);
  EXPECT_NE(loop.error().what.find("cannot start a thread"), std::string::npos) << loop.error().message();
}

}  // namespace
}  // namespace palpate
