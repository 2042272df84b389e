#include "phantoms/shape_ellipsoid.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

namespace palpate {
namespace {

using Eigen::Vector3d;

constexpr std::uint64_t kEllipsoidSeed = 20240612;

double level(const Vector3d& x, const Vector3d& radii) {
  return x.cwiseQuotient(radii).squaredNorm();
}

// Conditions for the nearest point x: it lies on the surface, and p lies on its normal.
void expect_nearest(const Vector3d& p, const Vector3d& radii) {
  const NearestOnEllipsoid nearest = nearest_on_ellipsoid(p, radii);
  ASSERT_TRUE(nearest.point.allFinite());
  EXPECT_NEAR(level(nearest.point, radii), 1, 1e-10) << p.transpose() << " / " << radii.transpose();
  const Vector3d normal = nearest.point.cwiseQuotient(radii.cwiseAbs2()).normalized();
  const Vector3d along = p - nearest.point;
  EXPECT_LT(along.cross(normal).norm(), 1e-9 * (1 + p.norm())) << p.transpose() << " / " << radii.transpose();
  EXPECT_NEAR(std::abs(nearest.distance), along.norm(), 1e-12 * (1 + p.norm()));
  EXPECT_EQ(nearest.distance < 0, level(p, radii) < 1);
}

TEST(NearestOnEllipsoid, LiesOnTheSurfaceBelowTheQuery) {
  std::mt19937_64 random(kEllipsoidSeed);
  SCOPED_TRACE(kEllipsoidSeed);
  std::uniform_real_distribution<double> within(-40, 40), exponent(-1, 1.5);
  for (int n = 0; n < 3000; ++n) {
    const Vector3d radii(std::pow(10, exponent(random)), std::pow(10, exponent(random)),
                         std::pow(10, exponent(random)));
    expect_nearest(Vector3d(within(random), within(random), within(random)), radii);
  }
}

TEST(NearestOnEllipsoid, IsNotBeatenByAnySurfacePoint) {
  std::mt19937_64 random(kEllipsoidSeed);
  std::normal_distribution<double> normal;
  const Vector3d radii(12, 5, 2);
  for (int n = 0; n < 40; ++n) {
    const Vector3d p(5 * normal(random), 3 * normal(random), normal(random));
    const double distance = std::abs(nearest_on_ellipsoid(p, radii).distance);
    for (int s = 0; s < 3000; ++s) {
      const Vector3d on_sphere = Vector3d(normal(random), normal(random), normal(random)).normalized();
      EXPECT_GE((radii.cwiseProduct(on_sphere) - p).norm(), distance - 1e-12) << "seed " << kEllipsoidSeed;
    }
  }
}

TEST(NearestOnEllipsoid, OfTheCentreIsTheEndOfTheShortestAxis) {
  EXPECT_DOUBLE_EQ(nearest_on_ellipsoid(Vector3d::Zero(), {5, 3, 8}).distance, -3);
  EXPECT_DOUBLE_EQ(nearest_on_ellipsoid(Vector3d::Zero(), {4, 4, 4}).distance, -4);
  EXPECT_DOUBLE_EQ(nearest_on_ellipsoid(Vector3d::Zero(), {2, 2, 9}).distance, -2);
}

TEST(NearestOnEllipsoid, OnPlanesOfSymmetryWithinAndBeyondTheCentresOfCurvature) {
  const Vector3d radii(10, 6, 3);
  // x axis: within (a^2 - c^2) / a = 9.1 of the centre the nearest point is off the axis
  for (const double x : {0.5, 4.0, 9.0, 9.1, 9.2, 9.9, 10.0, 15.0}) expect_nearest({x, 0, 0}, radii);
  EXPECT_DOUBLE_EQ(nearest_on_ellipsoid({9.5, 0, 0}, radii).distance, -0.5);
  EXPECT_GT(nearest_on_ellipsoid({9, 0, 0}, radii).distance, -1);
  for (const double y : {0.1, 2.0, 4.4, 4.5, 4.6, 7.0}) expect_nearest({0, y, 0}, radii);
  expect_nearest({3, 2, 0}, radii);
  expect_nearest({8, 0, 1}, radii);
}

TEST(NearestOnEllipsoid, IsContinuousUpToThePlanes) {
  const Vector3d radii(10, 6, 3);
  const double on_plane = nearest_on_ellipsoid({3, 2, 0}, radii).distance;
  for (const double z : {1e-3, 1e-8, 1e-16, 1e-100, 1e-200, 1e-310}) {
    EXPECT_NEAR(nearest_on_ellipsoid({3, 2, z}, radii).distance, on_plane, z + 1e-12) << z;
    EXPECT_NEAR(level(nearest_on_ellipsoid({3, 2, z}, radii).point, radii), 1, 1e-10) << z;
  }
}

TEST(NearestOnEllipsoid, OfASphereIsTheSphere) {
  std::mt19937_64 random(kEllipsoidSeed);
  std::uniform_real_distribution<double> within(-9, 9);
  for (int n = 0; n < 200; ++n) {
    const Vector3d p(within(random), within(random), within(random));
    EXPECT_NEAR(nearest_on_ellipsoid(p, {5, 5, 5}).distance, p.norm() - 5, 1e-12);
  }
}

TEST(NearestOnEllipsoid, SurvivesNeedlesDiscsAndFarPoints) {
  for (const Vector3d& radii :
       {Vector3d(100, 0.1, 0.1), Vector3d(100, 100, 0.1), Vector3d(5, 5 + 1e-12, 5)}) {
    for (const Vector3d& p :
         {Vector3d(1, 1, 1), Vector3d(99, 0.01, 0.01), Vector3d(50, 0, 1e-9), Vector3d(1e6, 1, -1)}) {
      expect_nearest(p, radii);
    }
  }
}

}  // namespace
}  // namespace palpate
