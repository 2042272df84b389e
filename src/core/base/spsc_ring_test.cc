#include "palpate/base/spsc_ring.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <array>
#include <cstdint>
#include <deque>
#include <random>
#include <thread>
#include <vector>

#include "palpate/base/clock.h"

namespace palpate {
namespace {

// words that are all derived from the first, so that a torn or stale copy is detected
struct Item {
  Item() = default;
  explicit Item(std::uint64_t number) {
    for (std::size_t i = 0; i < words.size(); ++i) words[i] = number * (i + 1);
  }
  std::uint64_t number() const { return words[0]; }
  bool whole() const { return words == Item(number()).words; }
  std::array<std::uint64_t, 7> words{};
};

TEST(SpscRing, RoundsItsCapacityUpToAPowerOfTwo) {
  EXPECT_EQ(SpscRing<int>(0).capacity(), 1u);
  EXPECT_EQ(SpscRing<int>(1).capacity(), 1u);
  EXPECT_EQ(SpscRing<int>(5).capacity(), 8u);
  EXPECT_EQ(SpscRing<int>(1024).capacity(), 1024u);
}

TEST(SpscRing, EqualsABoundedDeque) {
  constexpr std::uint64_t kSeed = 20240701;
  SCOPED_TRACE(kSeed);
  std::mt19937_64 random(kSeed);
  for (const std::size_t capacity : {1, 2, 8, 64}) {
    SpscRing<Item> ring(capacity);
    std::deque<std::uint64_t> oracle;
    std::vector<Item> out(2 * capacity + 1);
    for (std::uint64_t n = 0; n < 20000; ++n) {
      // more pushes than pops, but pops of up to twice the capacity: the ring is often full and often empty
      if (random() % 4 != 0) {
        const bool fits = oracle.size() < capacity;
        ASSERT_EQ(ring.push(Item(n)), fits);
        if (fits) oracle.push_back(n);
      } else {
        const std::size_t requested = random() % out.size();
        out[requested] = Item(~n);
        const std::size_t count = ring.pop(std::span(out).first(requested));
        ASSERT_EQ(count, std::min(requested, oracle.size()));
        for (std::size_t i = 0; i < count; ++i, oracle.pop_front()) {
          ASSERT_EQ(out[i].number(), oracle.front());
          ASSERT_TRUE(out[i].whole());
        }
        ASSERT_EQ(out[requested].number(), ~n) << "written beyond the span";
      }
      ASSERT_EQ(ring.size(), oracle.size());
    }
  }
}

TEST(SpscRing, CopiesOnlyTheGivenNumberOfBytes) {
  SpscRing<Item> ring(2);
  std::array<Item, 2> out;
  for (std::uint64_t n = 1; n <= 5; ++n) {
    ASSERT_TRUE(ring.push(Item(n), 3 * sizeof(std::uint64_t)));
    ASSERT_EQ(ring.pop(out), 1u);
    EXPECT_EQ(out[0].words, (std::array<std::uint64_t, 7>{n, 2 * n, 3 * n, 0, 0, 0, 0}));
  }
}

TEST(SpscRing, PagesAreResidentAtConstruction) {
  struct Page {
    std::array<char, 4096> bytes;  // no initialisation that would touch the memory
  };
  const auto faults = [] {
    rusage usage{};
    ::getrusage(RUSAGE_THREAD, &usage);
    return usage.ru_minflt;
  };
  SpscRing<Page> ring(4096);
  const Page page{};
  const auto before = faults();
  while (ring.push(page)) {
  }
  // 4096 without pre-touched pages, and at least 8 where the system maps 2 MiB at a time
  EXPECT_LE(faults() - before, 4);
}

// A run between two threads, of a number of items or a duration: every accepted item arrives once, intact and
// in order.
void run_two_threads(std::size_t capacity, std::uint64_t items, bool retry) {
  SpscRing<Item> ring(capacity);
  std::atomic<bool> done = false;
  std::uint64_t sent = 0, dropped = 0;
  std::thread producer([&] {
    for (const std::int64_t end_ns = monotonic_ns() + 200'000'000; sent < items && monotonic_ns() < end_ns;
         ++sent) {
      bool pushed = ring.push(Item(sent));
      while (!pushed && retry) {
        std::this_thread::yield();
        pushed = ring.push(Item(sent));
      }
      dropped += pushed ? 0 : 1;
    }
    done = true;
  });

  std::uint64_t received = 0, next = 0, out_of_order = 0, torn = 0, too_large = 0;
  std::vector<Item> out(capacity / 2 + 3);
  for (bool last = false; !last;) {
    // read before the pop: everything pushed before `done` is then certainly read by it
    last = done && ring.size() <= out.size();
    too_large += ring.size() > ring.capacity() ? 1 : 0;
    const std::size_t count = ring.pop(out);
    for (std::size_t i = 0; i < count; ++i) {
      torn += out[i].whole() ? 0 : 1;
      out_of_order += out[i].number() >= next ? 0 : 1;
      next = out[i].number() + 1;
    }
    received += count;
    if (count == 0) std::this_thread::yield();
  }
  producer.join();
  EXPECT_EQ(received + dropped, sent);
  EXPECT_GT(received, 0u);
  EXPECT_EQ(out_of_order, 0u);
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(too_large, 0u);
  EXPECT_TRUE(!retry || dropped == 0);
}

TEST(SpscRing, ConcurrentPushesAreLostOnlyWhenRejected) {
  run_two_threads(64, 300000, false);
}

TEST(SpscRing, RetriedPushesLoseNothing) {
  for (const std::size_t capacity : {1, 2, 16, 4096}) run_two_threads(capacity, 20000, true);
}

}  // namespace
}  // namespace palpate
