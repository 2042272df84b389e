#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "palpate/loading/loading.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

GridGeometry grid_of(int n, const Eigen::Vector3d& origin = Eigen::Vector3d::Zero()) {
  GridGeometry grid;
  grid.dims = {n, n, n};
  grid.origin = Point<Patient>(origin);
  return grid;
}

// a block of labels from voxel 2 to voxel 17 along each axis, 4096 voxels
LabelMap block(const GridGeometry& grid) {
  LabelMap map;
  map.layers.emplace_back(grid);
  for (int k = 2; k < 18; ++k)
    for (int j = 2; j < 18; ++j)
      for (int i = 2; i < 18; ++i) map.layers[0].at(i, j, k) = 1;
  map.segments = {{1, "liver", {}, 0, 1}};
  return map;
}

TEST(LabelPlacement, CountsCentresInTheScansVoxels) {
  const LabelMap map = block(grid_of(20));
  EXPECT_EQ(placement_of(map, grid_of(20)).fraction(), 1);
  EXPECT_EQ(placement_of(map, grid_of(20)).labelled, 4096u);
  // a scan that begins at voxel 10: 8 of 16 slices
  EXPECT_EQ(placement_of(map, grid_of(20, {10, 0, 0})).fraction(), 0.5);
  // a voxel extends half its width beyond its centre
  EXPECT_EQ(placement_of(map, grid_of(20, {2.4, 0, 0})).fraction(), 1);
  EXPECT_EQ(placement_of(map, grid_of(20, {2.6, 0, 0})).fraction(), 15.0 / 16);
  // a grid rotated by 180 degrees about z: an eighth of a centred block stays inside
  GridGeometry negated = grid_of(20);
  negated.direction.diagonal() << -1, -1, 1;
  EXPECT_EQ(placement_of(block(negated), grid_of(20)).fraction(), 0);
  // overlapping voxels count once; a map without labelled voxels counts as inside
  LabelMap two = map;
  two.layers.push_back(two.layers[0]);
  EXPECT_EQ(placement_of(two, grid_of(20)).labelled, 4096u);
  LabelMap none;
  none.layers.emplace_back(grid_of(20));
  EXPECT_EQ(placement_of(none, grid_of(20)).fraction(), 1);
}

TEST(LabelPlacement, ReportsWarnsAndRefuses) {
  const LabelPlacement all{1000, 1000}, most{1000, 999}, some{1000, 940}, few{1000, 499};
  EXPECT_EQ(in_words(all), "100.0 % of the labelled voxels lie inside the scan");
  EXPECT_EQ(in_words(LabelPlacement{100000, 99999}), "99.9 % of the labelled voxels lie inside the scan");
  EXPECT_EQ(placement_warning(most), "");
  EXPECT_THAT(placement_warning(some), HasSubstr("only 94.0 %"));
  EXPECT_TRUE(check_placement(some, "labels.nii", false));
  const auto refused = check_placement(few, "labels.nii", false);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().where, "labels.nii");
  EXPECT_THAT(refused.error().what, HasSubstr("only 49.9 %"));
  EXPECT_THAT(refused.error().remedy, HasSubstr("--cropped-scan"));
  EXPECT_TRUE(check_placement(few, "labels.nii", true));
}

}  // namespace
}  // namespace palpate
