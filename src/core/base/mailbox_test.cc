#include "palpate/base/mailbox.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <random>
#include <thread>

#include "base/test_child.h"
#include "palpate/base/clock.h"

namespace palpate {
namespace {

// copied by non-trivial functions, as Eigen's types are; all words are derived from the number
template <std::size_t words>
struct Letter {
  explicit Letter(std::uint64_t n = 0) { word.fill(n); }
  Letter(const Letter& other) : word(other.word) {}
  Letter& operator=(const Letter& other) {
    word = other.word;
    return *this;
  }
  bool whole() const {
    return std::all_of(word.begin(), word.end(), [&](std::uint64_t other) { return other == word[0]; });
  }
  std::uint64_t number() const { return word[0]; }
  std::array<std::uint64_t, words> word;
};

TEST(Mailbox, KeepsTheLatestPostUntilTaken) {
  constexpr std::uint64_t kSeed = 20240703;
  SCOPED_TRACE(kSeed);
  std::mt19937_64 random(kSeed);
  Mailbox<Letter<3>> mailbox;
  std::uint64_t waiting = 0;  // 0: nothing
  for (std::uint64_t n = 1; n < 20000; ++n) {
    if (random() % 2 == 0) {
      mailbox.post(Letter<3>(n));
      waiting = n;
    } else {
      Letter<3> letter(~n);
      ASSERT_EQ(mailbox.take(letter), waiting != 0);
      ASSERT_EQ(letter.number(), waiting != 0 ? waiting : ~n) << "changed although nothing was new";
      ASSERT_TRUE(letter.whole());
      waiting = 0;
    }
  }
}

TEST(Mailbox, ConcurrentPostsAreConsistentAndOrdered) {
  constexpr std::uint64_t kTaken = 20000;
  Mailbox<Letter<16>> mailbox;
  std::atomic<std::uint64_t> used = 0;
  std::atomic<bool> done = false;
  std::uint64_t posted = 0;
  std::thread writer([&] {
    for (const std::int64_t end_ns = monotonic_ns() + 1'000'000'000;
         used < kTaken && monotonic_ns() < end_ns;)
      mailbox.post(Letter<16>(++posted));
    done = true;
  });
  std::uint64_t last = 0, faults = 0;
  for (;;) {
    // read before the take: everything posted before `done` is then certainly read by it
    const bool finished = done;
    Letter<16> letter;
    if (mailbox.take(letter)) {
      if (!letter.whole() || letter.number() <= last) ++faults;
      last = letter.number();
      ++used;
    } else if (finished) {
      break;
    }
  }
  writer.join();
  EXPECT_EQ(faults, 0u);
  EXPECT_EQ(last, posted);
  EXPECT_GT(used, 4u);
}

TEST(Mailbox, KilledWriterDoesNotBlockTheReader) {
  // large enough that the writer is nearly always interrupted within a post
  using Large = Letter<32 * 1024>;
  struct Scene {
    Mailbox<Large> mailbox;
    std::atomic<std::uint64_t> begun = 0, ended = 0;
  };
  testing::Shared<Scene> scene;
  testing::Child writer([&] {
    static Large large;
    for (std::uint64_t n = 1;; ++n) {
      large = Large(n);
      ++scene->begun;
      scene->mailbox.post(large);
      ++scene->ended;
    }
  });
  ASSERT_TRUE(writer.stop_when([&] { return scene->ended > 3 && scene->begun != scene->ended; }));
  writer.kill();

  const auto letter = std::make_unique<Large>();
  ASSERT_TRUE(scene->mailbox.take(*letter));
  EXPECT_TRUE(letter->whole());
  EXPECT_GE(letter->number(), scene->ended);
  EXPECT_FALSE(scene->mailbox.take(*letter));
}

}  // namespace
}  // namespace palpate
