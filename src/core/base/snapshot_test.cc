#include "palpate/base/snapshot.h"

#include <gtest/gtest.h>

#include <memory>
#include <random>
#include <string>
#include <thread>

#include "base/test_child.h"
#include "palpate/base/clock.h"

namespace palpate {
namespace {

// bytes that are all derived from the number, so that a torn copy is detected
template <std::size_t words>
struct Block {
  Block() = default;
  explicit Block(std::uint64_t n) { word.fill(n); }
  bool whole() const {
    return std::all_of(word.begin(), word.end(), [&](std::uint64_t other) { return other == word[0]; });
  }
  std::uint64_t number() const { return word[0]; }
  std::array<std::uint64_t, words> word{};
};

template <std::size_t size>
void expect_round_trips(std::mt19937_64& random) {
  using Bytes = std::array<unsigned char, size>;
  Bytes bytes{};
  bytes.fill(7);
  Snapshot<Bytes> snapshot(bytes);
  EXPECT_EQ(snapshot.load(), bytes);
  EXPECT_EQ(snapshot.version(), 0u);
  for (std::uint64_t n = 1; n <= 100; ++n) {
    for (unsigned char& byte : bytes) byte = static_cast<unsigned char>(random());
    snapshot.store(bytes);
    Bytes loaded{};
    ASSERT_TRUE(snapshot.try_load(loaded));
    ASSERT_EQ(loaded, bytes) << size;
    ASSERT_EQ(snapshot.load(), bytes);
    ASSERT_EQ(snapshot.version(), n);
  }
}

TEST(Snapshot, RoundTripsEveryByteOfAnySize) {
  constexpr std::uint64_t kSeed = 20240702;
  SCOPED_TRACE(kSeed);
  std::mt19937_64 random(kSeed);
  expect_round_trips<1>(random);
  expect_round_trips<7>(random);
  expect_round_trips<8>(random);
  expect_round_trips<9>(random);
  expect_round_trips<984>(random);
}

TEST(Snapshot, StoresOnlyTheGivenNumberOfBytes) {
  Snapshot<Block<4>> snapshot(Block<4>(7));
  snapshot.store(Block<4>(9), 2 * sizeof(std::uint64_t));
  EXPECT_EQ(snapshot.load().word, (std::array<std::uint64_t, 4>{9, 9, 7, 7}));
  snapshot.store(Block<4>(5));
  EXPECT_EQ(snapshot.load().word, (std::array<std::uint64_t, 4>{5, 5, 5, 5}));
}

TEST(Snapshot, LoadsAreConsistentAndNeverOlder) {
  constexpr std::uint64_t kChanges = 20000;
  Snapshot<Block<16>> snapshot;
  std::atomic<bool> done = false;
  std::atomic<std::uint64_t> faults = 0, changes = 0, failures = 0;
  const auto read = [&] {
    std::uint64_t last = 0;
    for (Block<16> block; !done;) {
      const std::uint64_t version = snapshot.version();
      if (!snapshot.try_load(block)) {
        ++failures;
        block = snapshot.load();
      }
      // a value is at least as new as the version read before it
      if (!block.whole() || block.number() < last || block.number() < version) ++faults;
      if (block.number() != last) ++changes;
      last = block.number();
    }
  };
  std::thread first(read), second(read);
  std::uint64_t n = 0;
  for (const std::int64_t end_ns = monotonic_ns() + 1'000'000'000;
       changes < kChanges && monotonic_ns() < end_ns;)
    snapshot.store(Block<16>(++n));
  done = true;
  first.join();
  second.join();
  EXPECT_EQ(faults, 0u);
  EXPECT_GT(changes, 4u);
  EXPECT_EQ(snapshot.load().number(), n);
  EXPECT_EQ(snapshot.version(), n);
  RecordProperty("failed_tries", std::to_string(failures));
}

// large enough that a process is nearly always stopped within a copy
using Large = Block<32 * 1024>;
struct LargeScene {
  Snapshot<Large> snapshot;
  std::atomic<std::uint64_t> begun = 0, ended = 0, torn = 0;
  bool in_the_middle() const { return begun > 3 && begun != ended; }
};

void load_for_ever(LargeScene& scene) {
  static Large value;
  for (;;) {
    ++scene.begun;
    const bool loaded = scene.snapshot.try_load(value);
    ++scene.ended;
    if (loaded && !value.whole()) ++scene.torn;
  }
}

TEST(Snapshot, StoppedOrKilledReaderDoesNotBlockTheWriter) {
  testing::Shared<LargeScene> scene;
  testing::Child reader([&] { load_for_ever(*scene); });
  auto written = std::make_unique<Large>();
  auto observed = std::make_unique<Large>();
  std::uint64_t n = 0;
  const auto expect_the_writer_goes_on = [&] {
    for (const std::uint64_t until = n + 50; n < until;) {
      *written = Large(++n);
      scene->snapshot.store(*written);
      ASSERT_TRUE(scene->snapshot.try_load(*observed));
      ASSERT_EQ(observed->number(), n);
      ASSERT_TRUE(observed->whole());
    }
  };

  // stopped half-way: the copy that it continues afterwards mixes two versions and must be discarded
  ASSERT_TRUE(reader.stop_when([&] { return scene->in_the_middle(); }));
  expect_the_writer_goes_on();
  const std::uint64_t ended = scene->ended;
  reader.resume();
  while (scene->ended < ended + 10) ::usleep(100);

  ASSERT_TRUE(reader.stop_when([&] { return scene->in_the_middle(); }));
  reader.kill();
  expect_the_writer_goes_on();
  EXPECT_EQ(scene->torn, 0u);
}

TEST(Snapshot, KilledWriterLeavesNoReadableValue) {
  testing::Shared<LargeScene> scene;
  testing::Child writer([&] {
    static Large value;
    for (;;) {
      value = Large(++scene->begun);
      scene->snapshot.store(value);
    }
  });
  auto value = std::make_unique<Large>(77);
  ASSERT_TRUE(writer.stop_when([&] { return scene->begun > 3 && !scene->snapshot.try_load(*value); }));
  writer.kill();
  EXPECT_EQ(scene->snapshot.version(), scene->begun - 1);
  *value = Large(77);
  EXPECT_FALSE(scene->snapshot.try_load(*value));
  EXPECT_TRUE(value->whole());
  EXPECT_EQ(value->number(), 77u) << "a try that fails changes nothing";
}

}  // namespace
}  // namespace palpate
