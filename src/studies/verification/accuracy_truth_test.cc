#include "verification/accuracy_truth.h"

#include <gtest/gtest.h>

#include <cmath>

#include "verification/accuracy_random.h"
#include "verification/smoothed_indicator.h"

namespace palpate {
namespace {

using Eigen::Vector3d;

std::array<AxisWeight, 3> gaussians(const Vector3d& sigma_mm) {
  return {AxisWeight::gaussian(sigma_mm[0]), AxisWeight::gaussian(sigma_mm[1]),
          AxisWeight::gaussian(sigma_mm[2])};
}

std::array<AxisWeight, 3> compact(double radius_mm) {
  return {AxisWeight::compact(radius_mm), AxisWeight::compact(radius_mm), AxisWeight::compact(radius_mm)};
}

TEST(AxisWeight, IntegratesItsDensityToOne) {
  for (const AxisWeight& weight : {AxisWeight::gaussian(0.7), AxisWeight::compact(4.5)}) {
    const int count = 20000;
    const double step = 2 * weight.reach_mm() / count;
    double sum = 0, second_moment = 0;
    for (int n = 0; n < count; ++n) {
      const double x = -weight.reach_mm() + (n + 0.5) * step;
      sum += step * weight.density(x);
      second_moment += step * weight.density(x) * x * x;
      if (n % 1000 == 0) {
        EXPECT_NEAR(weight.integral(x + 0.5 * step), sum, 1e-6) << x;
      }
    }
    EXPECT_NEAR(sum, 1, 1e-6);
    EXPECT_EQ(weight.integral(-weight.reach_mm()), 0);
    EXPECT_EQ(weight.integral(weight.reach_mm()), 1);
    EXPECT_EQ(weight.density(1.001 * weight.reach_mm()), 0);
    // with R = 3 sigma the second moment equals that of the Gaussian
    EXPECT_NEAR(second_moment, weight.reach_mm() == 4.5 ? 1.5 * 1.5 : 0.7 * 0.7, 1e-5);
  }
}

TEST(SmoothedSolid, OfEqualGaussiansIsTheClosedForm) {
  AccuracyRandom random(1);
  const Shape ball = Shape::sphere({}, 20), torus = Shape::torus({}, {0, 0, 1}, 20, 8);
  for (int n = 0; n < 100; ++n) {
    const Point<Patient> p((20 + random.between(-0.75, 0.75)) * random.direction());
    EXPECT_NEAR(smoothed_solid(ball, p, gaussians({0.9, 0.9, 0.9})), smoothed_ball(p.eigen().norm(), 20, 0.9),
                1e-5);
    EXPECT_NEAR(smoothed_solid(ball, p, gaussians({1.5, 1.5, 1.5})), smoothed_ball(p.eigen().norm(), 20, 1.5),
                1e-5);
    const Vector3d ring = Vector3d(random.direction().x(), random.direction().y(), 0).normalized();
    const Point<Patient> q(20 * ring + (8 + random.between(-0.75, 0.75)) * random.direction());
    EXPECT_NEAR(smoothed_solid(torus, q, gaussians({1, 1, 1})),
                smoothed_torus(std::hypot(q.x(), q.y()), q.z(), 20, 8, 1), 1e-5);
  }
}

TEST(SmoothedSolid, OfUnequalGaussiansIsAHalfSpacesOwnWidth) {
  const Vector3d normal(0.36, 0.48, 0.8), sigma(0.28, 0.28, 1.0);
  const Shape plane = Shape::half_space({}, Vector<Patient>(normal));
  const double across = normal.cwiseProduct(sigma).norm();
  for (const double distance : {-1.2, -0.3, 0.0, 0.5, 1.5})
    EXPECT_NEAR(
        smoothed_solid(plane, Point<Patient>(distance * normal + Vector3d(4, -3, 0)), gaussians(sigma)),
        smoothed_half_space(distance, across), 1e-6);
}

// Independent reference: the weights summed over a lattice of points inside.
double lattice_sum(const Shape& shape, const Point<Patient>& p, const std::array<AxisWeight, 3>& weights,
                   int count) {
  double sum = 0;
  Vector3d step, offset;
  for (int a = 0; a < 3; ++a) step[a] = 2 * weights[static_cast<std::size_t>(a)].reach_mm() / count;
  const auto weigh = [&](int axis, int n) {
    const AxisWeight& weight = weights[static_cast<std::size_t>(axis)];
    offset[axis] = -weight.reach_mm() + (n + 0.5) * step[axis];
    return weight.density(offset[axis]) * step[axis];
  };
  for (int i = 0; i < count; ++i) {
    const double wi = weigh(0, i);
    for (int j = 0; j < count; ++j) {
      const double wj = weigh(1, j);
      for (int k = 0; k < count; ++k) {
        const double wk = weigh(2, k);
        if (shape.distance_mm(p + Vector<Patient>(offset)) < 0) sum += wi * wj * wk;
      }
    }
  }
  return sum;
}

TEST(SmoothedSolid, EqualsASumOverItsPoints) {
  const Shape cylinder = Shape::cylinder({-30, -40, -70}, {30, 40, 70}, 10);
  const Shape torus = Shape::torus({}, {0.36, 0.48, 0.8}, 20, 8);
  const Point<Patient> on_torus(13, -21, 4.5);
  const Point<Patient> near_torus = on_torus - torus.distance_mm(on_torus) * torus.normal(on_torus);
  const Point<Patient> on_cylinder(8, 6, 0);
  const Point<Patient> near_cylinder =
      on_cylinder - (cylinder.distance_mm(on_cylinder) - 0.4) * cylinder.normal(on_cylinder);
  for (const auto& weights : {compact(4.5), gaussians({0.28, 0.28, 1.0})}) {
    EXPECT_NEAR(smoothed_solid(torus, near_torus, weights), lattice_sum(torus, near_torus, weights, 100),
                2e-3);
    EXPECT_NEAR(smoothed_solid(cylinder, near_cylinder, weights),
                lattice_sum(cylinder, near_cylinder, weights, 100), 2e-3);
  }
}

TEST(SmoothedSolid, CompactKernelIsOneInsideAndZeroOutside) {
  const Shape ball = Shape::sphere({}, 20);
  EXPECT_NEAR(smoothed_solid(ball, {12.1, 0, 0}, compact(4.5)), 1, 1e-9);
  EXPECT_EQ(smoothed_solid(ball, {0, 24.6, 0}, compact(4.5)), 0);
  // for a half-space normal to an axis the result is the integral of the weight
  const Shape wall = Shape::half_space({}, {0, 1, 0});
  EXPECT_NEAR(smoothed_solid(wall, {3, 1.2, -7}, compact(4.5)), AxisWeight::compact(4.5).integral(-1.2),
              1e-7);
}

// A thin plate has two crossings within the reach, and a line may miss it.
TEST(SmoothedSolid, IncludesBothSidesOfAThinSolid) {
  const Shape plate = Shape::box({}, {50, 50, 0.25});
  const AxisWeight weight = AxisWeight::gaussian(1);
  for (const double z : {-1.0, 0.0, 0.3, 2.0})
    EXPECT_NEAR(smoothed_solid(plate, {1, 2, z}, gaussians({1, 1, 1})),
                weight.integral(0.25 - z) - weight.integral(-0.25 - z), 1e-6);
}

}  // namespace
}  // namespace palpate
