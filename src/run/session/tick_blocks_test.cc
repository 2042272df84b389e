#include "session/tick_blocks.h"

#include <gtest/gtest.h>

#include <semaphore>

#include "base/test_wait.h"

namespace palpate {
namespace {

constexpr std::size_t kBlocks = 12;
constexpr double kBlock_s = 1;

// block of two ticks, at its beginning and in its middle
TickBlocks::Block block_of(std::size_t number) {
  TickBlocks::Block ticks(2);
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    ticks[i].tick = 2 * number + i;
    ticks[i].time_s = kBlock_s * (static_cast<double>(number) + 0.5 * static_cast<double>(i));
  }
  return ticks;
}

std::vector<double> begins_s() {
  std::vector<double> begins;
  for (std::size_t n = 0; n < kBlocks; ++n) begins.push_back(kBlock_s * static_cast<double>(n));
  return begins;
}

// Reader that reads one block per call of read_one().
class TickBlocksReadSlowly : public ::testing::Test {
 protected:
  ~TickBlocksReadSlowly() override {
    ended_ = true;
    reported_.release(2);
  }
  // number of the tick shown, if any
  std::optional<std::uint64_t> shown_at(double at_s, int direction, double from_s) {
    const auto tick = blocks_.tick_at(at_s, direction, from_s);
    return tick ? std::optional(tick->tick) : std::nullopt;
  }
  // waits until the reader is about to read `block`
  bool comes_to_read(std::size_t block) {
    return testing::soon([&] { return reading_ == block; });
  }
  void read_one() {
    const int before = read_;
    reported_.release();
    ASSERT_TRUE(testing::soon([&] { return read_ > before; }));
  }

 private:
  std::atomic<bool> ended_{false};
  std::atomic<int> read_{0};
  std::atomic<std::size_t> reading_{kBlocks};
  std::counting_semaphore<> reported_{0};

 protected:
  TickBlocks blocks_{[this](std::size_t block, const Progress&) -> Result<TickBlocks::Block> {
                       reading_ = block;
                       reported_.acquire();
                       if (ended_) return Progress::interrupted();
                       ++read_;
                       return block_of(block);
                     },
                     begins_s()};
};

TEST_F(TickBlocksReadSlowly, FastPlaybackShowsTheLatestReadBlock) {
  EXPECT_EQ(shown_at(0.6, 1, 0.6), std::nullopt);
  ASSERT_TRUE(comes_to_read(0));
  EXPECT_EQ(shown_at(3.2, 1, 0.6), std::nullopt);
  read_one();
  ASSERT_TRUE(testing::soon([&] { return shown_at(3.2, 1, 0.6) == 1; })) << "of the block that it began in";
  // by the time it has been read, playback has passed the next block
  ASSERT_TRUE(comes_to_read(3));
  EXPECT_EQ(shown_at(7.9, 1, 0.6), 1);
  read_one();
  ASSERT_TRUE(testing::soon([&] { return shown_at(7.9, 1, 0.6) == 7; }));
  ASSERT_TRUE(comes_to_read(7));
  read_one();
  ASSERT_TRUE(testing::soon([&] { return shown_at(7.9, 1, 0.6) == 15; })) << "the tick itself";

  // after a seek no tick before the target is shown, and while paused no substitute at all
  EXPECT_EQ(shown_at(10.2, 1, 10.2), std::nullopt);
  EXPECT_EQ(shown_at(10.2, 0, 10.2), std::nullopt);
  // backwards
  EXPECT_EQ(shown_at(9.1, -1, 11.7), std::nullopt);
  EXPECT_EQ(shown_at(5.1, -1, 7.3), 14);
}

}  // namespace
}  // namespace palpate
