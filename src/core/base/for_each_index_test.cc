#include "palpate/base/for_each_index.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <stdexcept>
#include <thread>
#include <vector>

#include "base/test_processors.h"

namespace palpate {
namespace {

TEST(ForEachIndex, VisitsEachIndexOnceForAnyNumberOfWorkers) {
  for (const int workers : {1, 2, 3, 64}) {
    for (const int count : {0, 1, 2, 7, 1000}) {
      std::vector<std::atomic<int>> used(static_cast<std::size_t>(count));
      // one list for each worker: no lock
      std::vector<std::vector<std::thread::id>> threads(static_cast<std::size_t>(workers));
      EXPECT_TRUE(for_each_index(count, workers, [&](int worker, int index) {
        used[static_cast<std::size_t>(index)] += 1;
        threads.at(static_cast<std::size_t>(worker)).push_back(std::this_thread::get_id());
        return true;
      }));
      for (const auto& times : used) EXPECT_EQ(times, 1) << workers << " workers, " << count;
      for (const auto& own : threads)
        EXPECT_TRUE(std::ranges::all_of(own, [&](std::thread::id thread) { return thread == own[0]; }));
    }
  }
}

TEST(ForEachIndex, RunsConcurrently) {
  std::atomic<int> there{0};
  EXPECT_TRUE(for_each_index(2, 2, [&](int, int) {
    // each waits for the other
    for (++there; there < 2;) std::this_thread::yield();
    return true;
  }));
}

TEST(ForEachIndex, StopsAfterACallReturnsFalse) {
  for (const int workers : {1, 4}) {
    std::atomic<int> begun{0};
    EXPECT_FALSE(for_each_index(1'000'000, workers, [&](int, int) { return ++begun < 10; }));
    // every other worker may already have been about to start one
    EXPECT_LE(begun, 10 + workers - 1);
  }
}

TEST(ForEachIndex, RethrowsExceptionsInTheCaller) {
  for (const int workers : {1, 4}) {
    std::atomic<int> begun{0};
    EXPECT_THROW(for_each_index(1'000'000, workers,
                                [&](int, int) -> bool {
                                  if (++begun >= 10) throw std::runtime_error("for a test");
                                  return true;
                                }),
                 std::runtime_error);
    EXPECT_LE(begun, 10 + workers - 1);
  }
}

TEST(ForEachIndex, WithoutThreadsTheCallerVisitsAllIndices) {
  const test::NoThreads none;
  int used = 0;
  EXPECT_TRUE(for_each_index(100, 4, [&](int worker, int) {
    EXPECT_EQ(worker, 0);
    return ++used > 0;
  }));
  EXPECT_EQ(used, 100);
}

TEST(ForEachIndex, WorkerCountDefaultsToAvailableProcessors) {
  EXPECT_EQ(worker_count(3, 100), 3);
  EXPECT_EQ(worker_count(3, 2), 2);
  EXPECT_EQ(worker_count(3, 0), 1);
  EXPECT_EQ(worker_count(0, 1'000'000), processors());
  const test::OneProcessor one;
  EXPECT_EQ(processors(), 1);
  EXPECT_EQ(worker_count(0, 100), 1);
}

#ifdef __SANITIZE_THREAD__
// ThreadSanitizer knows where a loop begins and ends, and still reports a race between two calls of work.
TEST(ForEachIndexDeathTest, ThreadSanitizerReportsARaceOfTwoCalls) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto race = [] {
    std::atomic<int> there{0};
    volatile int shared = 0;
    for_each_index(2, 2, [&](int, int index) {
      // both calls are running, and neither synchronises with the other
      there.fetch_add(1, std::memory_order_relaxed);
      while (there.load(std::memory_order_relaxed) < 2) std::this_thread::yield();
      shared = index;
      return true;
    });
  };
  EXPECT_EXIT(race(); std::exit(0), ::testing::ExitedWithCode(66), "data race");
}
#endif

}  // namespace
}  // namespace palpate
