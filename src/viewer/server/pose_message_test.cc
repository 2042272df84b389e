#include "server/pose_message.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "server/test_client.h"

namespace palpate::server {
namespace {

using palpate::testing::number_at;

TickRecord full_tick(int devices) {
  TickRecord tick;
  tick.tick = 0x0102030405060708;
  tick.time_s = 12.5;
  tick.model_version = 0x0a0b0c0d;
  tick.method = 5;
  tick.switches = 0x15;
  tick.rotation_target_wxyz = {9, 9, 9, 9};
  tick.rotation_applied_wxyz = {0.5, -0.5, 0.25, 0.75};
  tick.devices = devices;
  for (int d = 0; d < kMaxDevices; ++d) {
    DeviceTick& device = tick.device[d];
    const double base = 1000 * (d + 1);
    device.tip_patient_mm = {base + 1, base + 2, base + 3};
    device.proxy_patient_mm = {base + 4, base + 5, base + 6};
    device.normal_patient = {base + 7, base + 8, base + 9};
    device.orientation_wxyz = {base + 10, base + 11, base + 12, base + 13};
    device.force_N = {base + 14, base + 15, base + 16};
    device.unclamped_force_N = base + 17;
    device.limit_N = base + 18;
    device.heat = base + 19;
    device.depth_mm = base + 20;
    // speed 5 mm/s
    device.velocity_patient_mm_s = {3, 0, -4};
    device.flags = 0x80000001u + static_cast<std::uint32_t>(d);
    device.buttons = 0x11223344;
    device.label = static_cast<std::uint16_t>(0xfe00 + d);
    // the second device's force is above what its field can hold
    device.cutting_N = d == 1 ? 100 : 1.25;
    device.cutting_energy_mJ_per_mm3 = base + 29;
    for (std::size_t n = 0; n < device.path_label.size(); ++n) {
      device.path_label[n] = static_cast<std::uint16_t>(100 * (d + 1) + static_cast<int>(n));
      device.path_depth_mm[n] = base + 30 + static_cast<double>(n);
      device.path_share[n] = base + 40 + static_cast<double>(n);
    }
    for (std::size_t n = 0; n < device.contact_label.size(); ++n) {
      device.contact_label[n] = static_cast<std::uint16_t>(200 * (d + 1) + static_cast<int>(n));
      device.contact_part[n] = static_cast<std::uint16_t>(n);
      for (std::size_t axis = 0; axis < 3; ++axis)
        device.contact_patient_mm[3 * n + axis] = base + 50 + static_cast<double>(10 * n + axis);
      device.contact_N[n] = base + 53 + static_cast<double>(10 * n);
    }
  }
  return tick;
}

const ViewedHealth kHealth{999.5, 1, 2, 3, 4, 5, 6, std::uint64_t{1} << 40};

// every offset as in the document
TEST(PoseMessage, HeadMatchesTheDocumentedLayout) {
  PoseMessage pose(full_tick(1), {0.5, 0, 0, 0}, kHealth, 0x1122334455667788);
  pose.set_sequence(0xa1a2a3a4a5a6a7a8);
  const std::string_view bytes = pose.bytes();
  ASSERT_EQ(bytes.size(), 96u + 296u);
  EXPECT_EQ(bytes.substr(0, 4), "PLPT");
  EXPECT_EQ(number_at<std::uint16_t>(bytes, 4), 3);
  EXPECT_EQ(number_at<std::uint16_t>(bytes, 6), 392);
  EXPECT_EQ(number_at<std::uint64_t>(bytes, 8), 0xa1a2a3a4a5a6a7a8);
  EXPECT_EQ(number_at<std::uint64_t>(bytes, 16), 0x0102030405060708u);
  EXPECT_EQ(number_at<double>(bytes, 24), 12.5);
  EXPECT_EQ(number_at<std::uint64_t>(bytes, 32), 0x1122334455667788u);
  EXPECT_EQ(number_at<std::uint32_t>(bytes, 40), 0x0a0b0c0du);
  EXPECT_EQ(number_at<std::uint8_t>(bytes, 44), 5);
  EXPECT_EQ(number_at<std::uint8_t>(bytes, 45), 0x15);
  EXPECT_EQ(number_at<std::uint8_t>(bytes, 46), 1);
  EXPECT_EQ(number_at<std::uint8_t>(bytes, 47), 0);
  EXPECT_EQ(number_at<float>(bytes, 48), 0.5f);
  EXPECT_EQ(number_at<float>(bytes, 52), -0.5f);
  EXPECT_EQ(number_at<float>(bytes, 56), 0.25f);
  EXPECT_EQ(number_at<float>(bytes, 60), 0.75f);
  EXPECT_EQ(number_at<float>(bytes, 64), 999.5f);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(number_at<float>(bytes, 68 + 4 * i), static_cast<float>(1 + i));
  EXPECT_EQ(number_at<std::uint32_t>(bytes, 84), 5u);
  EXPECT_EQ(number_at<std::uint32_t>(bytes, 88), 6u);
  // saturates: exceeds the field's range
  EXPECT_EQ(number_at<std::uint32_t>(bytes, 92), 0xffffffffu);
}

TEST(PoseMessage, NumbersAreLittleEndian) {
  PoseMessage pose(full_tick(1), {}, kHealth, 0);
  pose.set_sequence(0x0102030405060708);
  EXPECT_EQ(pose.bytes().substr(4, 2), std::string_view("\x03\x00", 2));
  EXPECT_EQ(pose.bytes().substr(8, 8), "\x08\x07\x06\x05\x04\x03\x02\x01");
}

TEST(PoseMessage, DevicesMatchTheDocumentedLayout) {
  for (int devices = 1; devices <= kMaxDevices; ++devices) {
    const PoseMessage pose(full_tick(devices), {0.1, 0.2, 0.3, 0.4}, kHealth, 0);
    const std::string_view bytes = pose.bytes();
    ASSERT_EQ(bytes.size(), 96u + 296u * devices);
    EXPECT_EQ(number_at<std::uint16_t>(bytes, 6), bytes.size());
    EXPECT_EQ(number_at<std::uint8_t>(bytes, 46), devices);
    for (int d = 0; d < devices; ++d) {
      const std::size_t at = 96 + 296 * static_cast<std::size_t>(d);
      const float base = 1000.0f * static_cast<float>(d + 1);
      // tip, proxy, normal, orientation, force, unclamped force, limit, heat, depth: contiguous floats
      for (int i = 0; i < 20; ++i)
        EXPECT_EQ(number_at<float>(bytes, at + 4 * i), base + static_cast<float>(i + 1)) << d << " " << i;
      EXPECT_EQ(number_at<float>(bytes, at + 80), 5);
      EXPECT_EQ(number_at<float>(bytes, at + 84), 0.1f * static_cast<float>(d + 1));
      EXPECT_EQ(number_at<std::uint32_t>(bytes, at + 88), 0x80000001u + d);
      EXPECT_EQ(number_at<std::uint32_t>(bytes, at + 92), 0x11223344u);
      EXPECT_EQ(number_at<std::uint16_t>(bytes, at + 96), 0xfe00 + d);
      EXPECT_EQ(number_at<std::uint16_t>(bytes, at + 98), d == 1 ? 65535 : 1250);
      EXPECT_EQ(number_at<float>(bytes, at + 100), base + 29);
      for (std::size_t n = 0; n < 6; ++n) {
        const std::size_t there = at + 104 + 12 * n;
        EXPECT_EQ(number_at<std::uint16_t>(bytes, there), 100 * (d + 1) + static_cast<int>(n));
        EXPECT_EQ(number_at<std::uint16_t>(bytes, there + 2), 0);
        EXPECT_EQ(number_at<float>(bytes, there + 4), base + 30 + static_cast<float>(n));
        EXPECT_EQ(number_at<float>(bytes, there + 8), base + 40 + static_cast<float>(n));
      }
      for (std::size_t n = 0; n < 6; ++n) {
        const std::size_t there = at + 176 + 20 * n;
        EXPECT_EQ(number_at<std::uint16_t>(bytes, there), 200 * (d + 1) + static_cast<int>(n));
        EXPECT_EQ(number_at<std::uint16_t>(bytes, there + 2), n);
        // contiguous position and force
        for (std::size_t i = 0; i < 4; ++i)
          EXPECT_EQ(number_at<float>(bytes, there + 4 + 4 * i), base + 50 + static_cast<float>(10 * n + i));
      }
    }
  }
}

TEST(PoseMessage, UnknownValuesStayNaN) {
  TickRecord tick = full_tick(1);
  tick.device[0].depth_mm = kNoValue;
  tick.device[0].limit_N = 1e300;
  tick.device[0].heat = -std::numeric_limits<double>::infinity();
  const PoseMessage pose(tick, {}, kHealth, 0);
  EXPECT_TRUE(std::isnan(number_at<float>(pose.bytes(), 96 + 76)));
  EXPECT_EQ(number_at<float>(pose.bytes(), 96 + 68), std::numeric_limits<float>::infinity());
  EXPECT_EQ(number_at<float>(pose.bytes(), 96 + 72), -std::numeric_limits<float>::infinity());
}

}  // namespace
}  // namespace palpate::server
