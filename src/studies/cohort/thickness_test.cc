#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "palpate/cohort/thickness.h"

namespace palpate {
namespace {

GridGeometry grid_of_test(int n, const Eigen::Vector3d& spacing_mm) {
  GridGeometry grid;
  grid.dims = {n, n, n};
  grid.spacing_mm = spacing_mm;
  grid.origin = Point<Patient>(-20, 30, 5);
  return grid;
}

/// Volume with label 1 where `in` is true for a point relative to the volume's centre, mm.
template <class In>
Volume<LabelId> where(const GridGeometry& grid, const In& in) {
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d at(i - 0.5 * (grid.dims[0] - 1), j - 0.5 * (grid.dims[1] - 1),
                                 k - 0.5 * (grid.dims[2] - 1));
        labels.at(i, j, k) = in(Eigen::Vector3d(at.cwiseProduct(grid.spacing_mm))) ? 1 : 0;
      }
  return labels;
}

std::optional<ThinSpot> thinnest_of(const Volume<LabelId>& labels) {
  LabelMap map;
  map.layers.push_back(labels);
  Segment segment;
  segment.id = segment.value = 1;
  map.segments.push_back(segment);
  const auto statistics = segment_statistics(map);
  return statistics.empty() ? std::nullopt : minimum_thickness(labels, statistics.front());
}

TEST(NearestOutside, EqualsAnExhaustiveSearch) {
  constexpr unsigned kSeed = 20;
  std::mt19937 random(kSeed);
  for (int round = 0; round < 30; ++round) {
    std::uniform_int_distribution<int> size(1, 9);
    const std::array<int, 3> dims{size(random), size(random), size(random)};
    const Eigen::Vector3d spacing(0.3 + 0.1 * size(random), 0.3 + 0.1 * size(random),
                                  0.3 + 0.1 * size(random));
    const auto count = static_cast<std::size_t>(dims[0] * dims[1] * dims[2]);
    std::vector<std::uint8_t> outside(count);
    for (auto& one : outside) one = size(random) > 7;
    const NearestOutside nearest = nearest_outside(dims, spacing, outside);
    const auto at = [&](std::size_t n) -> Eigen::Vector3d {
      const auto row = static_cast<std::size_t>(dims[0]), rows = static_cast<std::size_t>(dims[1]);
      return Eigen::Vector3d(static_cast<double>(n % row), static_cast<double>(n / row % rows),
                             static_cast<double>(n / (row * rows)))
          .cwiseProduct(spacing);
    };
    for (std::size_t n = 0; n < count; ++n) {
      double smallest = std::numeric_limits<double>::infinity();
      for (std::size_t other = 0; other < count; ++other)
        if (outside[other]) smallest = std::min(smallest, (at(n) - at(other)).squaredNorm());
      if (std::isinf(smallest)) {
        EXPECT_EQ(nearest.squared_mm2[n], -1) << "seed " << kSeed << ", round " << round;
        continue;
      }
      ASSERT_NEAR(nearest.squared_mm2[n], smallest, 1e-4) << "seed " << kSeed << ", round " << round;
      ASSERT_GE(nearest.index[n], 0);
      const auto who = static_cast<std::size_t>(nearest.index[n]);
      EXPECT_TRUE(outside[who]);
      EXPECT_NEAR((at(n) - at(who)).squaredNorm(), smallest, 1e-4);
    }
  }
}

TEST(ThinnestPoint, MeasuresAPlate) {
  for (const Eigen::Vector3d& spacing : {Eigen::Vector3d(0.5, 0.5, 0.5), Eigen::Vector3d(0.6, 0.6, 1.2)})
    for (int voxels = 1; voxels <= 7; ++voxels) {
      const double half = 0.5 * voxels * spacing[2];
      const auto grid = grid_of_test(40 + voxels % 2, spacing);
      const auto thin = thinnest_of(where(grid, [&](const Eigen::Vector3d& at) {
        return std::abs(at[2]) < half && at.head<2>().norm() < 9;
      }));
      ASSERT_TRUE(thin) << voxels;
      EXPECT_NEAR(thin->thickness_mm, voxels * spacing[2], 1e-3) << voxels;
    }
}

TEST(ThinnestPoint, IsFoundWhereAPlateIsWornAndNotAtItsRim) {
  const auto grid = grid_of_test(64, {0.5, 0.5, 0.5});
  const Eigen::Vector3d worn(4, -3, 0);
  // a disc of 4 mm with tapered rim, worn to 2 mm at one location
  const auto thin = thinnest_of(where(grid, [&](const Eigen::Vector3d& at) {
    const double out = at.head<2>().norm(), top = out < 11 ? 2 : 2 * (13 - out) / 2;
    const double pit = 2.0 * std::exp(-(at - worn).head<2>().squaredNorm() / 8);
    return out < 13 && at[2] > -top && at[2] < top - pit;
  }));
  ASSERT_TRUE(thin);
  EXPECT_NEAR(thin->thickness_mm, 2, 0.75);
  const Eigen::Vector3d off = (thin->position - grid.centre()).eigen() - worn;
  EXPECT_LT(off.head<2>().norm(), 2.5);
}

TEST(ThinnestPoint, MeasuresASlantedPlateToAVoxel) {
  const auto grid = grid_of_test(56, {0.5, 0.5, 0.5});
  const Eigen::Vector3d normal = Eigen::Vector3d(1, 2, 3).normalized();
  const auto thin = thinnest_of(where(
      grid, [&](const Eigen::Vector3d& at) { return std::abs(at.dot(normal)) < 1.75 && at.norm() < 11; }));
  ASSERT_TRUE(thin);
  EXPECT_NEAR(thin->thickness_mm, 3.5, 0.75);
}

// the thickness of a coarsely voxelised bone is not affected by protrusions of its surface
TEST(ThinnestPoint, VoxelsThatStandOutAreNoPlates) {
  constexpr unsigned kSeed = 21;
  std::mt19937 random(kSeed);
  for (const double spacing_mm : {0.5, 1.0, 2.5}) {
    const auto grid = grid_of_test(30, Eigen::Vector3d::Constant(spacing_mm));
    const Volume<LabelId> smooth = where(grid, [&](const Eigen::Vector3d& at) {
      return std::abs(at[2]) < 5 * spacing_mm && at.head<2>().norm() < 13 * spacing_mm;
    });
    Volume<LabelId> labels = smooth;
    std::uniform_int_distribution<int> chance(0, 19);
    for (int k = 1; k < 29; ++k)
      for (int j = 1; j < 29; ++j)
        for (int i = 1; i < 29; ++i) {
          const int beside = smooth.at(i - 1, j, k) + smooth.at(i + 1, j, k) + smooth.at(i, j - 1, k) +
                             smooth.at(i, j + 1, k) + smooth.at(i, j, k - 1) + smooth.at(i, j, k + 1);
          if (smooth.at(i, j, k) == 0 && beside > 0 && chance(random) == 0) labels.at(i, j, k) = 1;
        }
    const auto thin = thinnest_of(labels);
    ASSERT_TRUE(thin);
    EXPECT_NEAR(thin->thickness_mm, 10 * spacing_mm, 2 * spacing_mm)
        << "seed " << kSeed << ", " << spacing_mm << " mm";

    Volume<LabelId> plate = where(grid, [&](const Eigen::Vector3d& at) {
      return std::abs(at[2]) < 2 * spacing_mm && at.head<2>().norm() < 9 * spacing_mm;
    });
    plate.at(15, 15, 17) = plate.at(11, 16, 12) = 1;
    const auto thick = thinnest_of(plate);
    ASSERT_TRUE(thick) << spacing_mm;
    EXPECT_NEAR(thick->thickness_mm, 4 * spacing_mm, 0.1 * spacing_mm);
  }
}

// a thin part next to a thick one is found
TEST(ThinnestPoint, APlateBetweenTwoBlocksIsThin) {
  for (const double spacing_mm : {0.5, 2.5}) {
    const auto grid = grid_of_test(40, Eigen::Vector3d::Constant(spacing_mm));
    const auto thin = thinnest_of(where(grid, [&](const Eigen::Vector3d& at) {
      const Eigen::Vector3d v = at / spacing_mm;
      const bool is_block = std::abs(v.x()) > 8 && v.cwiseAbs().maxCoeff() < 18;
      return is_block || (std::abs(v.x()) <= 8 && std::abs(v.y()) < 18 && std::abs(v.z()) < 1);
    }));
    ASSERT_TRUE(thin) << spacing_mm;
    EXPECT_NEAR(thin->thickness_mm, 2 * spacing_mm, 0.1 * spacing_mm);
    EXPECT_LT(std::abs((thin->position - grid.centre()).eigen().x()), 9 * spacing_mm);
  }
}

TEST(ThinnestPoint, EdgesAreNotThin) {
  const auto grid = grid_of_test(36, {1, 1, 1});
  const auto thin =
      thinnest_of(where(grid, [](const Eigen::Vector3d& at) { return at.cwiseAbs().maxCoeff() < 10; }));
  ASSERT_TRUE(thin);
  EXPECT_NEAR(thin->thickness_mm, 20, 1);
}

TEST(ThinnestPoint, TheVolumesBorderIsNoSide) {
  const auto grid = grid_of_test(24, {1, 1, 1});
  // extends through the whole volume along i and j
  const auto thin = thinnest_of(where(grid, [](const Eigen::Vector3d& at) { return std::abs(at[2]) < 3; }));
  ASSERT_TRUE(thin);
  EXPECT_NEAR(thin->thickness_mm, 6, 1e-3);
  EXPECT_FALSE(thinnest_of(where(grid, [](const Eigen::Vector3d&) { return true; })));
}

}  // namespace
}  // namespace palpate
