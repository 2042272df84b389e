#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "palpate/surfaces/surfaces.h"

namespace palpate {
namespace {

Volume<LabelId> empty_cube(int edge) {
  GridGeometry grid;
  grid.dims = {edge, edge, edge};
  grid.spacing_mm = Eigen::Vector3d(0.5, 0.5, 1);
  return Volume<LabelId>(grid);
}

std::size_t joints_of(const Volume<LabelId>& labels, const std::vector<LabelId>& structures) {
  std::size_t joints = 0;
  const auto leaky = find_leaks(*label_bricks(labels), structures);
  EXPECT_TRUE(leaky.ok());
  for (const Leaks& leaks : *leaky) joints += leaks.joints;
  return joints;
}

// a wall across the cube at x = 4 that continues at x = 5 from y = 5
Volume<LabelId> stepped_wall(bool joined_by_faces) {
  Volume<LabelId> labels = empty_cube(11);
  for (int k = 0; k < 11; ++k)
    for (int j = 0; j < 11; ++j) labels.at(j < 5 ? 4 : 5, j, k) = 3;
  if (joined_by_faces)
    for (int k = 0; k < 11; ++k) labels.at(4, 5, k) = 3;
  return labels;
}

TEST(Leaks, EdgeConnectedSheetLeaks) {
  const Volume<LabelId> wall = stepped_wall(false);
  for (const int threads : {1, 3}) {
    const auto leaky = find_leaks(*label_bricks(wall), {2, 3}, threads);
    ASSERT_TRUE(leaky.ok());
    ASSERT_EQ(leaky->size(), 1u);
    EXPECT_EQ(leaky->front().label, 3);
    EXPECT_EQ(leaky->front().joints, 6u) << "one in every slice that is not near the border";
    EXPECT_EQ(leaky->front().position, wall.geometry().X_PatientVoxel() * Point<Voxel>(4.5, 4.5, 2));
  }
  EXPECT_EQ(joints_of(stepped_wall(true), {3}), 0u);
  EXPECT_EQ(joints_of(wall, {}), 0u) << "of what is not felt nobody asks";
}

TEST(Leaks, OtherTouchableStructureClosesAJoint) {
  Volume<LabelId> wall = stepped_wall(false);
  for (int k = 0; k < 11; ++k) wall.at(5, 4, k) = 7;
  EXPECT_EQ(joints_of(wall, {3}), 6u);
  EXPECT_EQ(joints_of(wall, {3, 7}), 0u);
}

TEST(Leaks, SidesMeetingAtACornerAreAJoint) {
  // a wall of two voxels with a pit from either side, which meet at a corner
  Volume<LabelId> wall = empty_cube(11);
  for (int k = 0; k < 11; ++k)
    for (int j = 0; j < 11; ++j) wall.at(4, j, k) = wall.at(5, j, k) = 1;
  EXPECT_EQ(joints_of(wall, {1}), 0u);
  wall.at(4, 5, 5) = 0;
  wall.at(5, 6, 6) = 0;
  EXPECT_EQ(joints_of(wall, {1}), 1u);
}

TEST(Leaks, SmallComponentsAndPocketsAreIgnored) {
  Volume<LabelId> labels = empty_cube(13);
  for (int k = 3; k < 10; ++k)
    for (int j = 3; j < 10; ++j)
      for (int i = 3; i < 10; ++i) labels.at(i, j, k) = 1;
  labels.at(10, 10, 5) = 1;  // a crumb connected by an edge
  labels.at(2, 2, 2) = 1;    // another connected by a corner
  labels.at(8, 8, 6) = 0;    // a pocket below the surface
  labels.at(9, 9, 6) = 0;    // open to the outside by an edge
  EXPECT_EQ(joints_of(labels, {1}), 0u);
}

// a ball with random bumps: thick, whatever its surface
TEST(Leaks, RoughBallIsNotLeaky) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> bump(-0.4, 0.4);
  Volume<LabelId> labels = empty_cube(31);
  for (int k = 0; k < 31; ++k)
    for (int j = 0; j < 31; ++j)
      for (int i = 0; i < 31; ++i)
        labels.at(i, j, k) = std::hypot(i - 15, j - 15, k - 15) + bump(random) < 10;
  EXPECT_EQ(joints_of(labels, {1}), 0u);
}

TEST(Leaks, ThinVolumesAreAccepted) {
  for (const std::array<int, 3>& dims : {std::array{1, 1, 1}, std::array{1, 5, 5}, std::array{5, 1, 5},
                                         std::array{5, 5, 1}, std::array{2, 2, 1}}) {
    GridGeometry grid;
    grid.dims = dims;
    Volume<LabelId> labels(grid);
    for (std::size_t n = 0; n < labels.voxels().size(); n += 2) labels.voxels()[n] = 1;
    EXPECT_EQ(joints_of(labels, {1}), 0u);
  }
}

}  // namespace
}  // namespace palpate
