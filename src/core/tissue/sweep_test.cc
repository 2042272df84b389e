#include "palpate/tissue/sweep.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/test_seed.h"

namespace palpate {
namespace {

// maximum of a concave function on 0 ... 1, by ternary search
template <class F>
double greatest(const F& concave) {
  double low = 0, high = 1;
  for (int n = 0; n < 60; ++n) {
    const double a = low + (high - low) / 3, b = high - (high - low) / 3;
    if (concave(a) < concave(b))
      low = a;
    else
      high = b;
  }
  return std::max({concave(0.0), concave(low), concave(1.0)});
}

// maximum over the balls of the row of the maximum over their paths; partial maximisation of a jointly
// concave function is concave
double searched_depth_mm(const Sweep& sweep, const Point<Patient>& at) {
  return greatest([&](double t) {
    const Point<Patient> first = sweep.from + sweep.axis_mm * t;
    const double radius_mm = sweep.radius_mm + t * (sweep.end_radius_mm - sweep.radius_mm);
    return greatest(
        [&](double s) { return radius_mm - (at - (first + (sweep.to - sweep.from) * s)).norm(); });
  });
}

TEST(Sweep, DepthIsTheMaximumOverAllBalls) {
  const unsigned seed = test::test_seed();
  std::mt19937 random(seed);
  SCOPED_TRACE(seed);
  std::uniform_real_distribution<double> coordinate(-4, 4), unit(0, 1), about(-1, 1);
  const auto vector = [&](double length_mm) {
    return Vector<Patient>(about(random), about(random), about(random)).normalized() * length_mm;
  };
  int inside = 0, in_plane = 0;
  for (int n = 0; n < 400; ++n) {
    Sweep sweep;
    sweep.from = Point<Patient>(coordinate(random), coordinate(random), coordinate(random));
    sweep.radius_mm = 0.3 + 2 * unit(random);
    sweep.end_radius_mm = n % 3 == 0 ? sweep.radius_mm : 0.3 + 2 * unit(random);
    sweep.axis_mm = vector(0.2 + 5 * unit(random));
    Vector<Patient> displacement = vector(3 * unit(random));
    // along the axis, nearly so, zero, or almost zero
    if (n % 8 == 1) displacement = sweep.axis_mm * (0.3 * about(random));
    if (n % 8 == 2) displacement = sweep.axis_mm * 0.3 + vector(1e-5);
    if (n % 8 == 3) displacement = {};
    if (n % 8 == 4) displacement = vector(1e-6);
    sweep.to = sweep.from + displacement;
    const SweptShape shape(sweep);
    for (int m = 0; m < 12; ++m) {
      Point<Patient> at(coordinate(random), coordinate(random), coordinate(random));
      // every other point is near it, some in the plane of path and axis
      if (m % 2 == 0)
        at = sweep.from + displacement * unit(random) + sweep.axis_mm * unit(random) +
             vector(m % 4 == 0 ? 1.2 * sweep.radius_mm * unit(random) : 0);
      const double expected_mm = searched_depth_mm(sweep, at), is_mm = shape.depth_mm(at);
      ASSERT_NEAR(is_mm, expected_mm, 1e-6) << n << ' ' << m;
      inside += is_mm > 0;
      in_plane += m % 4 == 2;
      // no ball centre lies outside the bounding box
      const double box_mm =
          (shape.low() - at.eigen().array()).max(at.eigen().array() - shape.high()).max(0.0).matrix().norm();
      EXPECT_GE(shape.max_radius_mm() - box_mm, is_mm - 1e-9);
    }
  }
  EXPECT_GT(inside, 500);
  EXPECT_GT(in_plane, 500);
}

TEST(Sweep, SingleBallSweepsACapsule) {
  const Sweep sweep{{1, 2, 3}, {1, 2, 5}, 2};
  const SweptShape shape(sweep);
  EXPECT_EQ(shape.depth_mm(Point<Patient>(1, 2, 4)), 2);
  EXPECT_EQ(shape.depth_mm(Point<Patient>(1, 5, 4)), -1);
  EXPECT_EQ(shape.depth_mm(Point<Patient>(1, 2, 0)), -1);
  EXPECT_EQ(shape.max_radius_mm(), 2);
  EXPECT_EQ(distance_to_path_mm(sweep, Point<Patient>(1, 5, 4)), 3);
}

TEST(Sweep, EnclosingBallDefinesTheHead) {
  Sweep sweep{{0, 0, 0}, {0, 0, 0}, 2};
  sweep.axis_mm = {0, 0, 0.5};
  sweep.end_radius_mm = 1;
  EXPECT_DOUBLE_EQ(SweptShape(sweep).depth_mm(Point<Patient>(0, 0, 2.5)), -0.5);
  sweep.end_radius_mm = 3;
  EXPECT_DOUBLE_EQ(SweptShape(sweep).depth_mm(Point<Patient>(0, 0, -2.5)), 0);
}

}  // namespace
}  // namespace palpate
