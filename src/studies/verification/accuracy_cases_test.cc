#include "verification/accuracy_cases.h"

#include <gtest/gtest.h>

#include "verification/smoothed_indicator.h"

namespace palpate {
namespace {

TEST(AccuracyCases, PointsLieInTheBandAndFillIt) {
  for (const AccuracyCase& shape : accuracy_cases(2000)) {
    ASSERT_EQ(shape.points.size(), 2000u);
    double smallest = 1, most = -1;
    for (const Point<Patient>& p : shape.points) {
      const double d = shape.shape.distance_mm(p);
      smallest = std::min(smallest, d);
      most = std::max(most, d);
    }
    EXPECT_GE(smallest, -kSurfaceBand_mm - 1e-9) << shape.name;
    EXPECT_LE(most, kSurfaceBand_mm + 1e-9) << shape.name;
    EXPECT_LT(smallest, -0.97 * kSurfaceBand_mm) << shape.name;
    EXPECT_GT(most, 0.97 * kSurfaceBand_mm) << shape.name;
  }
}

TEST(AccuracyCases, PointsAreFarFromTheVolumesBorder) {
  for (const AccuracyCase& shape : accuracy_cases(2000)) {
    const GridGeometry grid = accuracy_grid(shape, {0.625, 0.625, 0.9});
    const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
    for (const Point<Patient>& p : shape.points) {
      const Point<Voxel> voxel = X_VoxelPatient * p;
      for (int a = 0; a < 3; ++a) {
        const double inwards = std::min(voxel[a], grid.dims[static_cast<std::size_t>(a)] - 1 - voxel[a]);
        // four sigma and the voxel of the central difference
        EXPECT_GT(inwards * grid.spacing_mm[a], 4 * 1.5 + grid.spacing_mm[a]) << shape.name;
      }
    }
  }
}

TEST(AccuracyCases, SmoothedSolidFallsAlongTheNormalAndIsHalfNearTheSurface) {
  for (const AccuracyCase& shape : accuracy_cases(50)) {
    for (const Point<Patient>& p : shape.points) {
      const Vector<Patient> n = shape.shape.normal(p);
      const Point<Patient> on_surface = p - shape.shape.distance_mm(p) * n;
      EXPECT_NEAR(shape.smoothed(on_surface, 1.0), 0.5, 0.06) << shape.name;
      const double slope =
          (shape.smoothed(on_surface + 1e-3 * n, 1.0) - shape.smoothed(on_surface - 1e-3 * n, 1.0)) / 2e-3;
      EXPECT_NEAR(slope, -1 / std::sqrt(2 * std::acos(-1.0)), 0.02) << shape.name;
      // the tangential slope is zero
      const Vector<Patient> lateral(n.eigen().unitOrthogonal());
      const double drift = shape.smoothed(p + 1e-3 * lateral, 1.0) - shape.smoothed(p - 1e-3 * lateral, 1.0);
      EXPECT_NEAR(drift / 2e-3, 0, 2e-3) << shape.name;
    }
  }
}

TEST(AccuracyCases, AreTheSameAtEveryCall) {
  const auto a = accuracy_cases(20), b = accuracy_cases(20);
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_EQ(a[i].points, b[i].points);
}

}  // namespace
}  // namespace palpate
