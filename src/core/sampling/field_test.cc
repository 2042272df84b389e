#include <gtest/gtest.h>

#include "palpate/sampling/sampling.h"

namespace palpate {
namespace {

TEST(Field, DefaultFieldIsFreeSpace) {
  const Field field;
  EXPECT_EQ(sample_value(field, Point<Patient>(0, 0, 0)), 0);
  EXPECT_EQ(sample_central_differences(field, Point<Patient>(0, 0, 0)).gradient, Vector<Patient>());
}

TEST(Field, ReportsItsStorage) {
  GridGeometry grid;
  grid.dims = {2, 3, 4};
  EXPECT_EQ(Field(Volume<std::uint8_t>(grid)).bytes_per_voxel(), 1);
  EXPECT_EQ(Field(Volume<std::uint16_t>(grid)).bytes_per_voxel(), 2);
  EXPECT_EQ(Field(Volume<std::uint16_t>(grid)).geometry().dims, grid.dims);
}

TEST(Field, TransformsMatchAnObliqueLeftHandedGrid) {
  GridGeometry grid;
  grid.dims = {4, 5, 6};
  grid.spacing_mm = {0.3, 0.7, 1.1};
  grid.direction = Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  grid.direction.col(2) *= -1;
  grid.origin = Point<Patient>(-30, 12, 5);
  ASSERT_FALSE(grid.right_handed());
  const Field field{Volume<std::uint8_t>(grid)};

  const Point<Voxel> index(1.25, 3.5, -2);
  const Point<Voxel> back = field.X_VoxelPatient() * (grid.X_PatientVoxel() * index);
  EXPECT_LT((back - index).norm(), 1e-12);

  // a gradient dotted with a displacement is the change of value, in whichever frame both are expressed
  const Eigen::Vector3d per_voxel(0.2, -0.5, 0.9), step(0.1, 0.4, -0.3);
  const Eigen::Vector3d per_mm = field.gradient_map() * per_voxel;
  EXPECT_NEAR(per_mm.dot(grid.X_PatientVoxel().linear() * step), per_voxel.dot(step), 1e-13);
}

}  // namespace
}  // namespace palpate
