#include "server/deformation_message.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::testing::number_at;
using palpate::testing::TestFrame;
using palpate::testing::TestServer;
using palpate::testing::TestViewer;

// grid at rest except for a box, each node of which has a distinct displacement
ViewedDeformation deformation_of(std::array<int, 3> nodes, std::array<int, 3> lo, std::array<int, 3> size) {
  ViewedDeformation deformation;
  deformation.frame = 77;
  deformation.nodes = nodes;
  deformation.first_patient_mm = {-10.5, 20.25, 30};
  deformation.axes = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  deformation.spacing_mm = 2.5;
  deformation.moved_mm.assign(3 * static_cast<std::size_t>(nodes[0]) * nodes[1] * nodes[2], 0);
  for (int k = lo[2]; k < lo[2] + size[2]; ++k)
    for (int j = lo[1]; j < lo[1] + size[1]; ++j)
      for (int i = lo[0]; i < lo[0] + size[0]; ++i)
        for (int c = 0; c < 3; ++c)
          deformation.moved_mm[3 * static_cast<std::size_t>(i + nodes[0] * (j + nodes[1] * k)) + c] =
              static_cast<float>(0.1 * i - 0.2 * j + 0.3 * k + c + 0.5);
  return deformation;
}

std::array<int, 3> three(std::string_view bytes, std::size_t at) {
  return {number_at<std::uint16_t>(bytes, at), number_at<std::uint16_t>(bytes, at + 2),
          number_at<std::uint16_t>(bytes, at + 4)};
}

// every offset as in the document
TEST(DeformationMessage, MatchesTheDocumentedLayout) {
  const ViewedDeformation deformation = deformation_of({6, 5, 4}, {1, 2, 1}, {3, 2, 2});
  const DeformationMessage message(2, &deformation);
  EXPECT_FALSE(message.rests());
  const std::string bytes = message.bytes();
  ASSERT_EQ(bytes.size(), 96u + 2 * 3 * 12);
  EXPECT_EQ(bytes.substr(0, 4), "PLPY");
  EXPECT_EQ(number_at<std::uint16_t>(bytes, 4), 3);
  EXPECT_EQ(number_at<std::uint16_t>(bytes, 6), 2);
  EXPECT_EQ(number_at<std::uint32_t>(bytes, 8), bytes.size());
  EXPECT_EQ(number_at<std::uint32_t>(bytes, 12), 77u);
  EXPECT_EQ(three(bytes, 16), (std::array{6, 5, 4}));
  EXPECT_EQ(three(bytes, 22), (std::array{1, 2, 1}));
  EXPECT_EQ(three(bytes, 28), (std::array{3, 2, 2}));
  EXPECT_EQ(number_at<std::uint16_t>(bytes, 34), 0);
  // first node, then the axes of i, j and k, then the spacing
  const std::array<float, 13> reals{-10.5f, 20.25f, 30, 0, 1, 0, -1, 0, 0, 0, 0, 1, 2.5f};
  for (std::size_t n = 0; n < reals.size(); ++n) EXPECT_EQ(number_at<float>(bytes, 36 + 4 * n), reals[n]);
  const float step_mm = number_at<float>(bytes, 88);
  EXPECT_EQ(step_mm, 0.001f);
  EXPECT_EQ(number_at<std::uint32_t>(bytes, 92), 0u);
  std::size_t at = 96;
  for (int k = 1; k < 3; ++k)
    for (int j = 2; j < 4; ++j)
      for (int i = 1; i < 4; ++i)
        for (int c = 0; c < 3; ++c, at += 2)
          EXPECT_NEAR(number_at<std::int16_t>(bytes, at) * step_mm,
                      deformation.moved_mm[3 * static_cast<std::size_t>(i + 6 * (j + 5 * k)) + c], 0.0006);
}

TEST(DeformationMessage, LargeDisplacementsHaveCoarserQuantization) {
  ViewedDeformation deformation = deformation_of({3, 3, 3}, {1, 1, 1}, {1, 1, 1});
  deformation.moved_mm[3 * 13] = -120;
  const std::string bytes = DeformationMessage(0, &deformation).bytes();
  EXPECT_EQ(number_at<std::int16_t>(bytes, 96), -32767);
  EXPECT_NEAR(number_at<std::int16_t>(bytes, 96) * number_at<float>(bytes, 88), -120, 0.002);
}

TEST(DeformationMessage, EmptyGridsAndZeroDisplacementsAreAtRest) {
  const ViewedDeformation fine = deformation_of({4, 4, 4}, {1, 1, 1}, {2, 2, 2});
  const std::string rest = DeformationMessage(1, nullptr).bytes();
  ASSERT_EQ(rest.size(), 96u);
  EXPECT_EQ(three(rest, 16), (std::array{0, 0, 0}));
  EXPECT_EQ(three(rest, 28), (std::array{0, 0, 0}));
  const auto expect_rest = [&](auto&& change) {
    ViewedDeformation deformation = fine;
    change(deformation);
    const DeformationMessage message(1, &deformation);
    EXPECT_TRUE(message.rests());
    EXPECT_EQ(message.bytes().size(), 96u);
    EXPECT_TRUE(message.is_indistinguishable_from(DeformationMessage(1, nullptr)));
  };
  expect_rest([](ViewedDeformation& deformation) {
    deformation.moved_mm.assign(deformation.moved_mm.size(), 0.004f);
  });
  expect_rest([](ViewedDeformation& deformation) { deformation.moved_mm.pop_back(); });
  expect_rest([](ViewedDeformation& deformation) {
    deformation.moved_mm[5] = std::numeric_limits<float>::quiet_NaN();
  });
  expect_rest([](ViewedDeformation& deformation) {
    deformation.moved_mm[5] = std::numeric_limits<float>::infinity();
  });
  expect_rest([](ViewedDeformation& deformation) { deformation.first_patient_mm[1] = kNoValue; });
  expect_rest([](ViewedDeformation& deformation) { deformation.axes[4] = kNoValue; });
  expect_rest([](ViewedDeformation& deformation) { deformation.spacing_mm = 0; });
  expect_rest([](ViewedDeformation& deformation) { deformation.nodes = {1, 8, 8}; });
  expect_rest([](ViewedDeformation& deformation) {
    deformation = deformation_of({65, 2, 2}, {1, 1, 1}, {1, 1, 1});
  });
  expect_rest([](ViewedDeformation& deformation) {
    deformation = deformation_of({33, 32, 32}, {1, 1, 1}, {1, 1, 1});
  });
  const ViewedDeformation largest = deformation_of({32, 32, 32}, {0, 0, 0}, {32, 32, 32});
  EXPECT_EQ(DeformationMessage(0, &largest).bytes().size(), 96u + 6 * 32768);
}

TEST(DeformationMessage, SubQuantumChangesAreIndistinguishable) {
  const ViewedDeformation before = deformation_of({4, 4, 4}, {1, 1, 1}, {2, 2, 2});
  ViewedDeformation now = before;
  now.frame = 78;
  now.moved_mm[3 * 21] += 0.0015f;
  EXPECT_TRUE(DeformationMessage(0, &now).is_indistinguishable_from(DeformationMessage(0, &before)));
  now.moved_mm[3 * 21] += 0.01f;
  EXPECT_FALSE(DeformationMessage(0, &now).is_indistinguishable_from(DeformationMessage(0, &before)));
  now = before;
  now.first_patient_mm[2] += 2.5;
  EXPECT_FALSE(DeformationMessage(0, &now).is_indistinguishable_from(DeformationMessage(0, &before)));
  EXPECT_FALSE(DeformationMessage(0, nullptr).is_indistinguishable_from(DeformationMessage(0, &before)));
}

// Next deformation message, skipping poses and texts; empty if there is none within `poses` poses.
std::string deformation_message(TestViewer& viewer, int poses = 1000) {
  for (TestFrame next = viewer.frame(); next.opcode >= 0 && poses > 0; next = viewer.frame()) {
    if (next.is_binary() && next.payload.starts_with("PLPY")) return next.payload;
    if (next.is_binary()) --poses;
  }
  return "";
}

std::shared_ptr<const ViewedDeformation> shared(ViewedDeformation deformation) {
  return std::make_shared<const ViewedDeformation>(std::move(deformation));
}

TEST(Viewer, HowTissueYieldsComesWhereItIsAnotherWayAndToOneThatComesLate) {
  TestServer test;
  const ViewedDeformation pressed = deformation_of({4, 4, 4}, {1, 1, 1}, {2, 2, 2});
  TestViewer first(test.port()), other(test.port());
  other.greet({{"poses_hz", 120}});
  EXPECT_EQ(deformation_message(other, 10), "");
  EXPECT_EQ(test.host.deformation_requested, 0) << "nobody wants it";
  first.greet({{"poses_hz", 120}, {"yielded", true}});
  EXPECT_EQ(deformation_message(first, 30), "") << "nothing has yielded";
  test.host.set_deformation(1, shared(pressed));
  EXPECT_EQ(deformation_message(first), DeformationMessage(1, &pressed).bytes());
  // the same deformation in another frame
  ViewedDeformation again = pressed;
  again.frame = 78;
  test.host.set_deformation(1, shared(again));
  EXPECT_EQ(deformation_message(first, 30), "");
  TestViewer late(test.port());
  late.greet({{"poses_hz", 120}, {"yielded", true}});
  EXPECT_EQ(deformation_message(late), DeformationMessage(1, &pressed).bytes());
  EXPECT_EQ(deformation_message(late, 30), "");
  // both devices, then none
  test.host.set_deformation(0, shared(again));
  EXPECT_EQ(deformation_message(late), DeformationMessage(0, &again).bytes());
  test.host.set_deformation(1, nullptr);
  EXPECT_EQ(deformation_message(late), DeformationMessage(1, nullptr).bytes());
  EXPECT_EQ(deformation_message(other, 10), "") << "one that did not ask";
}

// a viewer that does not read gets the latest message when it does, not the earlier ones
TEST(Viewer, SlowViewersReceiveTheLatestDeformation) {
  TestServer test;
  TestViewer slow(test.port(), "", false, 4096), other(test.port());
  for (TestViewer* viewer : {&slow, &other}) viewer->greet({{"yielded", true}});
  // more than the kernel's buffers hold
  ViewedDeformation deformation = deformation_of({20, 20, 20}, {0, 0, 0}, {20, 20, 20});
  constexpr int kReported = 6;
  for (int n = 0; n < kReported; ++n) {
    deformation.frame = static_cast<std::uint32_t>(n);
    deformation.spacing_mm = 1 + n;
    test.host.set_deformation(0, shared(deformation));
    std::string reported;
    // the message may be of the previous frame
    while ((reported = deformation_message(other)) != "" &&
           number_at<std::uint32_t>(reported, 12) != deformation.frame) {
    }
    ASSERT_FALSE(reported.empty());
  }
  int received = 0;
  std::uint32_t frame = 0;
  while (frame != kReported - 1) {
    const std::string is_reported = deformation_message(slow);
    ASSERT_FALSE(is_reported.empty());
    frame = number_at<std::uint32_t>(is_reported, 12);
    ++received;
  }
  EXPECT_LE(received, 3);
}

}  // namespace
}  // namespace palpate::server
