#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "base/test_processors.h"
#include "phantoms/test_shapes.h"

namespace palpate {
namespace {

using namespace testing;
using ::testing::HasSubstr;

// grid around the known shapes with cubic voxels of `voxel` mm
GridGeometry cube(double voxel) {
  GridGeometry grid;
  const int n = static_cast<int>(std::lround(36 / voxel));
  grid.dims = {n, n, n};
  grid.spacing_mm = Vector3d::Constant(voxel);
  grid.origin = Point<Patient>(placed(Vector3d::Zero()) - Vector3d::Constant(0.5 * voxel * (n - 1)));
  return grid;
}

// oblique, anisotropic and left-handed
GridGeometry awkward() {
  GridGeometry grid;
  grid.dims = {37, 29, 18};
  grid.spacing_mm = {0.7, 0.9, 1.6};
  grid.direction = turned().transpose() * Vector3d(1, 1, -1).asDiagonal();
  const Vector3d centre = grid.X_PatientVoxel().linear() * Vector3d(18, 14, 8.5);
  grid.origin = Point<Patient>(placed(Vector3d::Zero()) - centre);
  return grid;
}

double covered_mm3(const Shape& shape, const GridGeometry& grid, int subsamples = 4) {
  const auto coverage = voxelize_coverage(shape, grid, subsamples);
  EXPECT_TRUE(coverage.ok());
  double sum = 0;
  for (const float c : coverage->voxels()) sum += c;
  return sum * grid.voxel_volume_mm3();
}

TEST(Voxelize, CoverageGivesTheVolumeOfEveryShape) {
  for (const KnownShape& known : known_shapes()) {
    EXPECT_NEAR(covered_mm3(known.shape, cube(0.5)) / known.volume_mm3, 1, 2e-3) << known.name;
  }
}

TEST(Voxelize, VolumeConvergesWithTheVoxelSize) {
  // mean error over several placements, to average out chance
  const auto error = [](double voxel) {
    double sum = 0;
    for (int n = 0; n < 8; ++n) {
      const Vector3d shift = voxel * Vector3d(0.13 * n, 0.37 * n, 0.21 * n);
      const Shape sphere = Shape::sphere(Point<Patient>(placed(shift)), 9);
      sum += std::abs(covered_mm3(sphere, cube(voxel), 2) / (4.0 / 3 * std::numbers::pi * 729) - 1) / 8;
    }
    return sum;
  };
  const double coarse = error(3), middle = error(1.5), fine = error(0.75);
  EXPECT_LT(middle, 0.7 * coarse);
  EXPECT_LT(fine, 0.7 * middle);
  EXPECT_LT(fine, 2e-3);
}

TEST(Voxelize, CoverageEqualsAskingEveryPoint) {
  const GridGeometry grid = awkward();
  const Transform<Patient, Voxel> X = grid.X_PatientVoxel();
  const int n = 3;
  for (const KnownShape& known : known_shapes()) {
    const auto coverage = voxelize_coverage(known.shape, grid, n);
    ASSERT_TRUE(coverage.ok());
    for (int k = 0; k < grid.dims[2]; ++k) {
      for (int j = 0; j < grid.dims[1]; ++j) {
        for (int i = 0; i < grid.dims[0]; ++i) {
          int inside = 0;
          for (int s = 0; s < n * n * n; ++s) {
            const auto centre_of = [&](int at, int step) { return at + (step % n + 0.5) / n - 0.5; };
            inside += known.shape.distance_mm(X * Point<Voxel>(centre_of(i, s), centre_of(j, s / n),
                                                               centre_of(k, s / n / n))) < 0;
          }
          ASSERT_NEAR(coverage->at(i, j, k), inside / 27.0, 1e-6)
              << known.name << " " << i << " " << j << " " << k;
        }
      }
    }
  }
}

TEST(Voxelize, BinaryEqualsAskingEveryCentre) {
  const GridGeometry grid = awkward();
  const Transform<Patient, Voxel> X = grid.X_PatientVoxel();
  for (const KnownShape& known : known_shapes()) {
    const auto labels = voxelize_binary(known.shape, grid, 7);
    ASSERT_TRUE(labels.ok());
    for (int k = 0; k < grid.dims[2]; ++k) {
      for (int j = 0; j < grid.dims[1]; ++j) {
        for (int i = 0; i < grid.dims[0]; ++i) {
          const LabelId expected = known.shape.distance_mm(X * Point<Voxel>(i, j, k)) < 0 ? 7 : 0;
          ASSERT_EQ(labels->at(i, j, k), expected) << known.name << " " << i << " " << j << " " << k;
        }
      }
    }
  }
}

TEST(Voxelize, SingleVoxelsAndThinGridsWork) {
  const Shape all = Shape::sphere(patient_point(0, 0, 0), 100);
  GridGeometry grid;
  for (const auto& dims : {std::array{1, 1, 1}, std::array{70, 1, 1}, std::array{1, 5, 33}}) {
    grid.dims = dims;
    const auto labels = voxelize_binary(all, grid);
    ASSERT_TRUE(labels.ok());
    for (const LabelId label : labels->voxels()) EXPECT_EQ(label, 1);
  }
}

TEST(Voxelize, TheSameBitsWithOneThreadAndMany) {
  const Shape shape = known_shapes()[5].shape;
  const auto many = voxelize_coverage(shape, cube(0.4));
  const test::OneProcessor one;
  const auto single = voxelize_coverage(shape, cube(0.4));
  ASSERT_TRUE(many.ok() && single.ok());
  EXPECT_EQ(many->voxels(), single->voxels());
}

TEST(Voxelize, TellsItsProgressUpToTheEnd) {
  double last = 0;
  int calls = 0;
  const Progress progress(
      [&](std::string_view, double fraction) {
        EXPECT_GT(fraction, last);
        last = fraction;
        ++calls;
      },
      nullptr);
  ASSERT_TRUE(voxelize_binary(known_shapes()[0].shape, cube(0.4), 1, progress).ok());
  EXPECT_EQ(last, 1);
  EXPECT_GT(calls, 8);
}

TEST(Voxelize, StopsWhenAsked) {
  const std::atomic<bool> stop = true;
  const Progress progress({}, &stop);
  const Shape shape = known_shapes()[0].shape;
  const auto labels = voxelize_binary(shape, cube(0.4), 1, progress);
  const auto coverage = voxelize_coverage(shape, cube(0.4), 4, progress);
  ASSERT_FALSE(labels.ok());
  ASSERT_FALSE(coverage.ok());
  EXPECT_EQ(labels.error().kind, ErrorKind::kInterrupted);
  EXPECT_EQ(coverage.error().kind, ErrorKind::kInterrupted);
}

TEST(Voxelize, RefusesGridsAndCountsThatCannotBe) {
  const Shape shape = known_shapes()[0].shape;
  GridGeometry empty = cube(1);
  empty.dims[1] = 0;
  GridGeometry flat = cube(1);
  flat.spacing_mm[2] = 0;
  for (const GridGeometry& grid : {empty, flat}) {
    const auto labels = voxelize_binary(shape, grid);
    ASSERT_FALSE(labels.ok());
    EXPECT_EQ(labels.error().kind, ErrorKind::kBadInput);
    EXPECT_THAT(labels.error().message(), HasSubstr("grid"));
  }
  for (const int n : {0, 17}) EXPECT_FALSE(voxelize_coverage(shape, cube(2), n).ok());
}

}  // namespace
}  // namespace palpate
