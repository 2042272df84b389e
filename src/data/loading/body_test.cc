#include "loading/body.h"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <numeric>

namespace palpate {
namespace {

constexpr int kEdge = 12;

GridGeometry cube() {
  GridGeometry grid;
  grid.dims = {kEdge, kEdge, kEdge};
  return grid;
}

template <class Inside>
Volume<LabelId> labelled(const Inside& inside) {
  Volume<LabelId> labels(cube());
  for (int k = 0; k < kEdge; ++k)
    for (int j = 0; j < kEdge; ++j)
      for (int i = 0; i < kEdge; ++i) labels.at(i, j, k) = inside(i, j, k) ? 1 : 0;
  return labels;
}

std::size_t inside(const std::vector<std::uint8_t>& mask) {
  return static_cast<std::size_t>(std::accumulate(mask.begin(), mask.end(), 0));
}

// from `low` to `high`, both included, in the plane of a slice
bool in_square(int i, int j, int low, int high) {
  return i >= low && i <= high && j >= low && j <= high;
}

TEST(BodyMask, AClosedShellHasAnInside) {
  const auto in_cube = [](int i, int j, int k, int low, int high) {
    return in_square(i, j, low, high) && k >= low && k <= high;
  };
  const auto shell =
      labelled([&](int i, int j, int k) { return in_cube(i, j, k, 2, 9) && !in_cube(i, j, k, 3, 8); });
  const auto mask = body_mask(shell, nullptr, {});
  ASSERT_TRUE(mask.ok());
  EXPECT_EQ(inside(*mask), 8u * 8 * 8);
}

TEST(BodyMask, ASkinThatTheScanCutsHasAnInsideInEachAxialSlice) {
  const auto tube =
      labelled([](int i, int j, int) { return in_square(i, j, 2, 9) && !in_square(i, j, 3, 8); });
  EXPECT_EQ(inside(body_mask(tube, nullptr, {}).value()), 8u * 8 * kEdge);
  // along another axis it is open in every axial slice, so nothing is enclosed
  const auto across =
      labelled([](int, int j, int k) { return in_square(j, k, 2, 9) && !in_square(j, k, 3, 8); });
  EXPECT_EQ(inside(body_mask(across, nullptr, {}).value()), (8u * 8 - 6 * 6) * kEdge);
  // a grid whose first axis is the patient's axial one
  GridGeometry turned = cube();
  turned.direction << 0, 0, 1, 0, 1, 0, 1, 0, 0;
  turned.direction.col(1) *= -1;
  const Volume<LabelId> of_turned(turned, across.voxels());
  EXPECT_EQ(inside(body_mask(of_turned, nullptr, {}).value()), 8u * 8 * kEdge);
}

TEST(BodyMask, FollowsTheSkinAndExcludesTheTable) {
  const auto organ = labelled([](int i, int j, int k) { return in_square(i, j, 5, 6) && k == 6; });
  Volume<float> scan(cube());
  for (int k = 0; k < kEdge; ++k)
    for (int j = 0; j < kEdge; ++j)
      for (int i = 0; i < kEdge; ++i) {
        const bool body = in_square(i, j, 2, 8), gas = in_square(i, j, 4, 4), table = j == 10;
        scan.at(i, j, k) = (body && !gas) || table ? 0 : -1000;
      }
  EXPECT_EQ(inside(body_mask(organ, &scan, -500).value()), 7u * 7 * kEdge);
  // without a threshold only labels determine the body
  EXPECT_EQ(inside(body_mask(organ, &scan, {}).value()), 4u);
}

TEST(BodyMask, CanBeInterrupted) {
  const auto organ = labelled([](int, int, int) { return true; });
  const std::atomic<bool> stop{true};
  const auto mask = body_mask(organ, nullptr, {}, Progress({}, &stop));
  ASSERT_FALSE(mask.ok());
  EXPECT_EQ(mask.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
