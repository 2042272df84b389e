#include "server/distance_message.h"

#include <gtest/gtest.h>

#include <string>

#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::testing::number_at;
using palpate::testing::TestFrame;
using palpate::testing::TestServer;
using palpate::testing::TestViewer;

TickRecord tick_near(int devices) {
  TickRecord tick;
  tick.tick = 0x0102030405060708;
  tick.devices = devices;
  for (int d = 0; d < kMaxDevices; ++d) {
    DeviceTick& device = tick.device[d];
    device.no_go = static_cast<std::uint16_t>(d + 1);
    device.no_go_depth_mm = 0.5 * (d + 1);
    device.no_go_N = 0.25 * (d + 1);
    for (std::size_t n = 0; n < kMaxNearReported; ++n) {
      device.near_label[n] = static_cast<std::uint16_t>(100 * (d + 1) + static_cast<int>(n));
      device.near_mm[n] = d - 2 + static_cast<double>(n);
    }
  }
  return tick;
}

// offsets as in the document
TEST(DistanceMessage, MatchesTheDocumentedLayout) {
  for (int devices = 1; devices <= kMaxDevices; ++devices) {
    const DistanceMessage near(tick_near(devices));
    const std::string_view bytes = near.bytes();
    ASSERT_EQ(bytes.size(), 24u + 76u * devices);
    EXPECT_EQ(bytes.substr(0, 4), "PLPN");
    EXPECT_EQ(number_at<std::uint16_t>(bytes, 4), 3);
    EXPECT_EQ(number_at<std::uint16_t>(bytes, 6), bytes.size());
    EXPECT_EQ(number_at<std::uint64_t>(bytes, 8), 0x0102030405060708u);
    EXPECT_EQ(number_at<std::uint16_t>(bytes, 16), devices);
    for (int d = 0; d < devices; ++d) {
      const std::size_t at = 24 + 76 * static_cast<std::size_t>(d);
      EXPECT_EQ(number_at<std::uint16_t>(bytes, at), d + 1);
      EXPECT_EQ(number_at<float>(bytes, at + 4), 0.5f * static_cast<float>(d + 1));
      EXPECT_EQ(number_at<float>(bytes, at + 8), 0.25f * static_cast<float>(d + 1));
      for (std::size_t n = 0; n < 8; ++n) {
        EXPECT_EQ(number_at<std::uint16_t>(bytes, at + 12 + 8 * n), 100 * (d + 1) + static_cast<int>(n));
        EXPECT_EQ(number_at<float>(bytes, at + 16 + 8 * n), static_cast<float>(d - 2 + static_cast<int>(n)));
      }
    }
  }
}

TEST(DistanceMessage, IgnoresTheTickNumber) {
  TickRecord tick = tick_near(2);
  const DistanceMessage before(tick);
  tick.tick += 7;
  EXPECT_TRUE(DistanceMessage(tick).equals_except_tick(before));
  tick.device[1].near_mm[7] += 0.01;
  EXPECT_FALSE(DistanceMessage(tick).equals_except_tick(before));
  EXPECT_FALSE(DistanceMessage(tick_near(1)).equals_except_tick(before));
}

// Next message of distances, skipping others; empty if there is none within `poses` poses.
std::string near_message(TestViewer& viewer, int poses = 1000) {
  for (TestFrame next = viewer.frame(); next.opcode >= 0 && poses > 0; next = viewer.frame()) {
    if (next.is_binary() && next.payload.starts_with("PLPN")) return next.payload;
    if (next.is_binary()) --poses;
  }
  return "";
}

TEST(Viewer, DistancesAreSentToSubscribersWhenTheyChange) {
  TestServer test;
  const auto without = [&] {
    TestViewer viewer(test.port());
    viewer.greet({{"poses_hz", 120}, {"near", true}});
    return near_message(viewer, 10);
  };
  EXPECT_EQ(without(), "") << "the scene tells nothing";

  TestServer telling({}, {5, 4, 3}, "script", {}, {{"ball", 1, ViewedNoGo::Ball{{0, 0, 0}, 5}}});
  TestViewer viewer(telling.port()), other(telling.port());
  viewer.greet({{"poses_hz", 120}, {"near", true}});
  other.greet({{"poses_hz", 120}});
  EXPECT_EQ(number_at<std::uint16_t>(near_message(viewer), 24), 0) << "nothing pushes";
  EXPECT_EQ(near_message(viewer, 10), "") << "nor is anything another";
  TickRecord pushed;
  pushed.device[0].no_go = 1;
  pushed.device[0].no_go_depth_mm = 0.75;
  telling.host.bring_near(pushed.device[0]);
  const std::string reported = near_message(viewer);
  EXPECT_EQ(number_at<std::uint16_t>(reported, 24), 1);
  EXPECT_EQ(number_at<float>(reported, 28), 0.75f);
  // the pose of the same tick, or a later one, follows it
  EXPECT_GE(number_at<std::uint64_t>(viewer.pose(), 16), number_at<std::uint64_t>(reported, 8));
  TestViewer late(telling.port());
  late.greet({{"poses_hz", 120}, {"near", true}});
  EXPECT_EQ(number_at<std::uint16_t>(near_message(late), 24), 1) << "one that comes late";
  EXPECT_EQ(near_message(other, 10), "") << "one that did not ask";
}

}  // namespace
}  // namespace palpate::server
