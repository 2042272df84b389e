#include <gtest/gtest.h>

#include <cmath>

#include "palpate/scene/scene.h"

namespace palpate {
namespace {

GridGeometry grid_of(double x, double y, double z) {
  GridGeometry grid;
  grid.dims = {10, 10, 10};
  grid.spacing_mm = {x, y, z};
  return grid;
}

// the slope at the surface of a smoothed step of that height equals the stiffness
TEST(MostForce, RisesAtTheSurfaceWithTheStiffness) {
  TissueSettings tissue;
  for (const double stiffness : {0.02, 1.5}) {
    for (const double sigma_mm : {0.5, 1.0, 3.0}) {
      tissue.stiffness_N_per_mm = stiffness;
      const double max_N = max_tissue_force_N(tissue, sigma_mm, grid_of(0.3, 0.3, 0.3));
      const auto force_N = [&](double depth_mm) {
        return max_N * 0.5 * std::erfc(-depth_mm / (sigma_mm * std::sqrt(2)));
      };
      constexpr double kStep_mm = 1e-4;
      EXPECT_NEAR((force_N(kStep_mm) - force_N(-kStep_mm)) / (2 * kStep_mm), stiffness, 1e-6 * stiffness);
    }
  }
}

TEST(MostForce, WithoutSmoothingTheRampIsAVoxelWide) {
  EXPECT_DOUBLE_EQ(max_tissue_force_N({}, 0, grid_of(0.4, 0.3, 1)), 0.3);
}

TEST(FieldGrid, IsTheFinerOneAndTheLabelsWhereEqual) {
  const GridGeometry fine = grid_of(0.5, 0.5, 1), coarse = grid_of(1, 1, 1), same = grid_of(1, 0.5, 0.5);
  EXPECT_EQ(&field_grid(&fine, &coarse), &fine);
  EXPECT_EQ(&field_grid(&coarse, &fine), &fine);
  EXPECT_EQ(&field_grid(&fine, &same), &fine);
  EXPECT_EQ(&field_grid(nullptr, &coarse), &coarse);
  EXPECT_EQ(&field_grid(&coarse, nullptr), &coarse);
}

TEST(WidestVoxel, CountsTheLabelsAndTheFieldsGrid) {
  const GridGeometry slices = grid_of(0.2, 0.2, 3), fine = grid_of(0.4, 0.4, 0.5), coarse = grid_of(4, 4, 4);
  EXPECT_EQ(largest_spacing_mm(&fine, nullptr), 0.5);
  EXPECT_EQ(largest_spacing_mm(nullptr, &slices), 3);
  EXPECT_EQ(largest_spacing_mm(&slices, &fine), 3) << "labels resampled onto a finer grid keep their steps";
  EXPECT_EQ(largest_spacing_mm(&fine, &coarse), 0.5) << "a coarser scan takes no part";
}

}  // namespace
}  // namespace palpate
