#include "palpate/tissue/sweep.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "base/test_seed.h"

namespace palpate {
namespace {

// the greatest over a lattice of (s, t), which is then made finer around the best place: the depth is concave
// in them
double searched_depth_mm(const Sweep& sweep, const Point<Patient>& at) {
  constexpr int kPlaces = 16;
  const auto depth_mm = [&](double s, double t) {
    const Point<Patient> middle = sweep.from + (sweep.to - sweep.from) * s + sweep.axis_mm * t;
    return sweep.radius_mm + t * (sweep.end_radius_mm - sweep.radius_mm) - (at - middle).norm();
  };
  double best_s = 0.5, best_t = 0.5, best_mm = -std::numeric_limits<double>::infinity();
  for (double half = 0.5; half > 1e-9; half *= 0.4) {
    const double around_s = best_s, around_t = best_t;
    for (int m = -kPlaces; m <= kPlaces; ++m)
      for (int n = -kPlaces; n <= kPlaces; ++n) {
        const double s = std::clamp(around_s + half * m / kPlaces, 0.0, 1.0);
        const double t = std::clamp(around_t + half * n / kPlaces, 0.0, 1.0);
        if (const double mm = depth_mm(s, t); mm > best_mm) {
          best_mm = mm;
          best_s = s;
          best_t = t;
        }
      }
  }
  return best_mm;
}

TEST(Sweep, ADepthIsTheGreatestOverAllBalls) {
  const unsigned seed = test::test_seed();
  std::mt19937 random(seed);
  SCOPED_TRACE(seed);
  std::uniform_real_distribution<double> place(-4, 4), unit(0, 1), about(-1, 1);
  const auto vector = [&](double length_mm) {
    return Vector<Patient>(about(random), about(random), about(random)).normalized() * length_mm;
  };
  int inside = 0, in_plane = 0;
  for (int n = 0; n < 400; ++n) {
    Sweep sweep;
    sweep.from = Point<Patient>(place(random), place(random), place(random));
    sweep.radius_mm = 0.3 + 2 * unit(random);
    sweep.end_radius_mm = n % 3 == 0 ? sweep.radius_mm : 0.3 + 2 * unit(random);
    sweep.axis_mm = vector(0.2 + 5 * unit(random));
    Vector<Patient> way = vector(3 * unit(random));
    // along the axis, nearly so, none, or hardly any
    if (n % 8 == 1) way = sweep.axis_mm * (0.3 * about(random));
    if (n % 8 == 2) way = sweep.axis_mm * 0.3 + vector(1e-5);
    if (n % 8 == 3) way = {};
    if (n % 8 == 4) way = vector(1e-6);
    sweep.to = sweep.from + way;
    const SweptShape shape(sweep);
    for (int m = 0; m < 12; ++m) {
      Point<Patient> at(place(random), place(random), place(random));
      // every other one near it, some on the plane of way and axis
      if (m % 2 == 0)
        at = sweep.from + way * unit(random) + sweep.axis_mm * unit(random) +
             vector(m % 4 == 0 ? 1.2 * sweep.radius_mm * unit(random) : 0);
      const double expected_mm = searched_depth_mm(sweep, at), is_mm = shape.depth_mm(at);
      ASSERT_NEAR(is_mm, expected_mm, 1e-6) << n << ' ' << m;
      inside += is_mm > 0;
      in_plane += m % 4 == 2;
      // no middle lies outside of its box
      const double box_mm = (shape.low() - at.eigen().array())
                                .max(at.eigen().array() - shape.high())
                                .max(0.0)
                                .matrix()
                                .norm();
      EXPECT_GE(shape.widest_mm() - box_mm, is_mm - 1e-9);
    }
  }
  EXPECT_GT(inside, 500);
  EXPECT_GT(in_plane, 500);
}

TEST(Sweep, OneBallIsAWayWithRoundEnds) {
  const Sweep sweep{{1, 2, 3}, {1, 2, 5}, 2};
  const SweptShape shape(sweep);
  EXPECT_EQ(shape.depth_mm(Point<Patient>(1, 2, 4)), 2);
  EXPECT_EQ(shape.depth_mm(Point<Patient>(1, 5, 4)), -1);
  EXPECT_EQ(shape.depth_mm(Point<Patient>(1, 2, 0)), -1);
  EXPECT_EQ(shape.widest_mm(), 2);
  EXPECT_EQ(distance_to_way_mm(sweep, Point<Patient>(1, 5, 4)), 3);
}

TEST(Sweep, ABallThatHoldsTheOtherIsAllOfTheHead) {
  Sweep sweep{{0, 0, 0}, {0, 0, 0}, 2};
  sweep.axis_mm = {0, 0, 0.5};
  sweep.end_radius_mm = 1;
  EXPECT_DOUBLE_EQ(SweptShape(sweep).depth_mm(Point<Patient>(0, 0, 2.5)), -0.5);
  sweep.end_radius_mm = 3;
  EXPECT_DOUBLE_EQ(SweptShape(sweep).depth_mm(Point<Patient>(0, 0, -2.5)), 0);
}

}  // namespace
}  // namespace palpate
