#include "servo/bare_loop.h"

#include <gtest/gtest.h>

#include <thread>

namespace palpate {
namespace {

TEST(BareLoop, MeasuresEveryTickOfItsTime) {
  const std::atomic<bool> stop = false;
  LatencyHistogram lateness;
  const BareLoop loop = run_bare_loop(2000, 0.2, 50e-6, {.lock_memory = false}, stop, lateness);
  // more only where the last points were skipped
  EXPECT_GE(loop.ticks + loop.skipped, 400u);
  EXPECT_LE(loop.ticks, 400u);
  EXPECT_GT(loop.ticks, 0u);
  EXPECT_EQ(lateness.summary().n, loop.ticks);
  EXPECT_GT(lateness.summary().max_us, 0);
  EXPECT_FALSE(loop.grant.scheduler.empty());
  EXPECT_FALSE(loop.grant.memory_locked);
}

TEST(BareLoop, StopsWhenAsked) {
  std::atomic<bool> stop = false;
  LatencyHistogram lateness;
  std::thread stopper([&] {
    while (lateness.summary().n < 3) std::this_thread::yield();
    stop = true;
  });
  const BareLoop loop = run_bare_loop(1000, 3600, 0, {.fifo = false, .lock_memory = false}, stop, lateness);
  stopper.join();
  EXPECT_GE(loop.ticks, 3u);
  EXPECT_LT(loop.ticks, 3'600'000u);
}

}  // namespace
}  // namespace palpate
