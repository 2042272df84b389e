#include "server/bundle_message.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "base/test_seed.h"
#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::testing::FakeRecording;
using palpate::testing::number_at;
using palpate::testing::TestFrame;
using palpate::testing::TestServer;
using palpate::testing::TestViewer;

TickRecord numbered_tick(std::uint64_t number, int devices = 1) {
  TickRecord tick;
  tick.tick = number;
  tick.time_s = 0.001 * static_cast<double>(number);
  tick.model_version = 7;
  tick.rotation_applied_wxyz = {0.5, 0.25, 0.125, 1};
  tick.devices = devices;
  for (int d = 0; d < devices; ++d) {
    DeviceTick& device = tick.device[d];
    const double n = 100.0 * (d + 1);
    device.tip_patient_mm = {n + 1, n + 2, n + 3};
    device.proxy_patient_mm = {n + 4, n + 5, n + 6};
    device.orientation_wxyz = {n + 7, n + 8, n + 9, n + 10};
    device.force_N = {n + 11, n + 12, static_cast<double>(number)};
    device.unclamped_force_N = 1e300;
    device.depth_mm = kNoValue;
    device.flags = 0x01020304u + static_cast<std::uint32_t>(d);
    device.buttons = 5;
    device.label = 300;
  }
  return tick;
}

// offsets as in the document
TEST(BundleMessage, MatchesTheDocumentedLayout) {
  for (int devices = 1; devices <= kMaxDevices; ++devices) {
    TickHistory history;
    for (std::uint64_t n = 0; n < 3; ++n) history.add(numbered_tick(0x0102030405060700 + n, devices));
    std::vector<BundledTick> scratch(8);
    SentTicks sent;
    std::string bytes;
    ASSERT_TRUE(next_bundle(history, sent, scratch, bytes));
    const std::size_t tick_bytes = 40 + 72 * static_cast<std::size_t>(devices);
    ASSERT_EQ(bytes.size(), 32 + 3 * tick_bytes);
    EXPECT_EQ(bytes.substr(0, 4), "PLPB");
    EXPECT_EQ(number_at<std::uint16_t>(bytes, 4), 3);
    EXPECT_EQ(number_at<std::uint32_t>(bytes, 8), bytes.size());
    EXPECT_EQ(number_at<std::uint32_t>(bytes, 12), 3u);
    EXPECT_EQ(number_at<std::uint64_t>(bytes, 16), 1u);
    EXPECT_EQ(number_at<std::uint64_t>(bytes, 24), 0u);
    for (std::size_t n = 0; n < 3; ++n) {
      const std::size_t at = 32 + n * tick_bytes;
      const std::uint64_t number = 0x0102030405060700 + n;
      EXPECT_EQ(number_at<std::uint64_t>(bytes, at), number);
      EXPECT_EQ(number_at<double>(bytes, at + 8), 0.001 * static_cast<double>(number));
      EXPECT_EQ(number_at<std::uint32_t>(bytes, at + 16), 7u);
      EXPECT_EQ(number_at<std::uint32_t>(bytes, at + 20), static_cast<unsigned>(devices));
      EXPECT_EQ(number_at<float>(bytes, at + 24), 0.5f);
      EXPECT_EQ(number_at<float>(bytes, at + 36), 1);
      for (int d = 0; d < devices; ++d) {
        const std::size_t of = at + 40 + 72 * static_cast<std::size_t>(d);
        const float first = 100 * static_cast<float>(d + 1);
        for (std::size_t part = 0; part < 12; ++part)
          EXPECT_EQ(number_at<float>(bytes, of + 4 * part), first + static_cast<float>(part + 1));
        EXPECT_EQ(number_at<float>(bytes, of + 52), std::numeric_limits<float>::infinity());
        EXPECT_TRUE(std::isnan(number_at<float>(bytes, of + 56)));
        EXPECT_EQ(number_at<std::uint32_t>(bytes, of + 60), 0x01020304u + static_cast<unsigned>(d));
        EXPECT_EQ(number_at<std::uint32_t>(bytes, of + 64), 5u);
        EXPECT_EQ(number_at<std::uint32_t>(bytes, of + 68), 300u);
      }
    }
    EXPECT_FALSE(next_bundle(history, sent, scratch, bytes)) << "each tick once";
  }
}

/// Ticks, losses and bundles read from messages of a single device.
struct Reader {
  std::vector<std::uint64_t> ticks;
  std::uint64_t lost = 0, bundles = 0;

  void read(const std::string& bytes) {
    const std::size_t count = number_at<std::uint32_t>(bytes, 12);
    ASSERT_EQ(bytes.size(), 32 + 112 * count);
    ASSERT_EQ(number_at<std::uint64_t>(bytes, 16), ++bundles);
    lost = number_at<std::uint64_t>(bytes, 24);
    for (std::size_t n = 0; n < count; ++n) {
      ticks.push_back(number_at<std::uint64_t>(bytes, 32 + 112 * n));
      ASSERT_EQ(number_at<double>(bytes, 40 + 112 * n), 0.001 * static_cast<double>(ticks.back()));
    }
    ASSERT_EQ(ticks.back() - ticks.front() + 1, ticks.size() + lost);
  }
};

// all ticks in a map, from which the ones that have to arrive are looked up
TEST(BundleMessage, ReadersOfAnySpeedMatchTheReferenceModel) {
  const auto seed = test::test_seed();
  std::mt19937_64 random(seed);
  for (int round = 0; round < 10; ++round) {
    TickHistory history;
    std::map<std::uint64_t, std::uint64_t> all;  // tick by its index
    std::vector<BundledTick> scratch(1 + random() % kMaxBundledTicks);
    SentTicks sent;
    Reader reader;
    std::vector<std::uint64_t> expected;
    std::uint64_t next = 0, number = random() % 1000;
    for (int step = 0; step < 30; ++step) {
      std::uint64_t count = random() % 200;
      if (random() % 8 == 0) count = TickHistory::kCapacity - 2 + random() % 5;
      for (; count > 0; --count) {
        // the session itself drops some
        number += random() % 50 == 0 ? 3 : 1;
        all[all.size()] = number;
        history.add(numbered_tick(number));
      }
      std::string bytes;
      if (random() % 3 == 0) continue;
      const bool any = next_bundle(history, sent, scratch, bytes);
      const std::uint64_t oldest =
          all.size() > TickHistory::kCapacity ? all.size() - TickHistory::kCapacity : 0;
      std::size_t left = scratch.size();
      for (next = std::max(next, oldest); next < all.size() && left > 0; --left)
        expected.push_back(all.at(next++));
      ASSERT_EQ(any, left < scratch.size()) << "seed " << seed;
      if (any) reader.read(bytes);
    }
    ASSERT_EQ(reader.ticks, expected) << "seed " << seed;
  }
}

// a connection on which a tick takes as long as at 100 kbit/s, and then one without limit
TEST(BundleLimit, KeepsWritesShortAndRecovers) {
  using std::chrono::microseconds;
  constexpr auto kTick = microseconds(9000);
  BundleLimit limit;
  std::chrono::nanoseconds longest{0};
  for (int n = 0; n < 20; ++n) {
    const auto duration = kTick * static_cast<int>(limit.ticks());
    if (n > 3) longest = std::max<std::chrono::nanoseconds>(longest, duration);
    limit.on_sent(duration);
  }
  EXPECT_LE(longest, std::chrono::milliseconds(500));
  EXPECT_GE(limit.ticks(), 16u);
  for (int n = 0; n < 6; ++n) limit.on_sent(microseconds(50));
  EXPECT_EQ(limit.ticks(), kMaxBundledTicks);
  for (int n = 0; n < 20; ++n) limit.on_sent(std::chrono::seconds(1));
  EXPECT_EQ(limit.ticks(), 16u) << "some ticks always";
}

TEST(TickHistory, IsReadWhileItIsWritten) {
  TickHistory history;
  constexpr std::uint64_t kTicks = 3 * TickHistory::kCapacity;
  std::thread writer([&] {
    for (std::uint64_t n = 0; n < kTicks; ++n) history.add(numbered_tick(n));
  });
  std::vector<BundledTick> out(64);
  for (std::uint64_t first = 0; first < kTicks;) {
    const std::size_t count = history.copy(first, out);
    for (std::size_t n = 0; n < count; ++n) {
      EXPECT_EQ(out[n].tick, first + n);
      EXPECT_EQ(out[n].device[0].force_N[2], static_cast<float>(first + n));
    }
    first += count;
  }
  writer.join();
}

// Next bundle, skipping other messages; empty if there is none within `poses` poses.
std::string bundle(TestViewer& viewer, int poses = 1000) {
  for (TestFrame next = viewer.frame(); next.opcode >= 0 && poses > 0; next = viewer.frame()) {
    if (next.is_binary() && next.payload.starts_with("PLPB")) return next.payload;
    if (next.is_binary()) --poses;
  }
  return "";
}
void add_ticks(TestServer& test, std::uint64_t from, std::uint64_t to) {
  for (std::uint64_t n = from; n < to; ++n) test.host.history.add(numbered_tick(n));
}

TEST(Viewer, SubscribersReceiveEveryTick) {
  TestServer test;
  add_ticks(test, 0, 100);
  TestViewer viewer(test.port()), other(test.port());
  viewer.greet({{"poses_hz", 120}, {"ticks", true}});
  other.greet({{"poses_hz", 120}});
  EXPECT_EQ(bundle(viewer, 10), "") << "ticks before the hello";
  add_ticks(test, 100, 1500);
  Reader reader;
  while (reader.ticks.size() < 1400) reader.read(bundle(viewer));
  EXPECT_EQ(reader.ticks.front(), 100u);
  EXPECT_EQ(reader.lost, 0u);
  EXPECT_EQ(bundle(other, 10), "");
  EXPECT_EQ(bundle(viewer, 10), "") << "each once";
}

TEST(Viewer, ARecordingHasNoBundles) {
  FakeRecording recording;
  ViewerServerOptions options;
  options.port = 0;
  const auto server = ViewerServer::start(recording, options);
  TestViewer viewer((*server)->port());
  viewer.greet({{"ticks", true}});
  EXPECT_EQ(bundle(viewer, 3), "");
}

TEST(Viewer, SlowTickReadersGetLossCountsAndDelayNoOtherViewer) {
  TestServer test;
  TestViewer slow(test.port(), "", false, 4096), fast(test.port());
  for (TestViewer* viewer : {&slow, &fast}) viewer->greet({{"poses_hz", 120}, {"ticks", true}});
  Reader had, all;
  std::uint64_t added = 0;
  // far more than sockets and history hold together
  constexpr std::uint64_t kTicks = 8 * TickHistory::kCapacity, kPart = 1000;
  while (added < kTicks) {
    add_ticks(test, added, added + kPart);
    added += kPart;
    while (all.ticks.size() < added) all.read(bundle(fast));
  }
  EXPECT_EQ(all.lost, 0u);
  while (had.ticks.empty() || had.ticks.back() + 1 < added) {
    const std::string next = bundle(slow);
    ASSERT_FALSE(next.empty());
    had.read(next);
  }
  EXPECT_GT(had.lost, 0u);
}

}  // namespace
}  // namespace palpate::server
