#include "contact/half_spaces.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "contact/test_random.h"

namespace palpate {
namespace {

using testing::random_direction;

constexpr unsigned kHalfSpacesSeed = 505;

Point<Patient> random_corner(std::mt19937& random, double spread_mm) {
  std::normal_distribution<double> normal(0, spread_mm);
  return {normal(random), normal(random), normal(random)};
}

// Dykstra's alternating projections converge to the closest point; slow, but independent of any active set
Point<Patient> by_dykstra(const Point<Patient>& x, const std::vector<HalfSpace>& half_spaces, int rounds) {
  Eigen::Vector3d q = x.eigen();
  std::vector<Eigen::Vector3d> returned(half_spaces.size(), Eigen::Vector3d::Zero());
  for (int round = 0; round < rounds; ++round)
    for (std::size_t i = 0; i < half_spaces.size(); ++i) {
      const Eigen::Vector3d before = q + returned[i];
      const double outside = half_spaces[i].offset - half_spaces[i].normal.eigen().dot(before);
      q = before + half_spaces[i].normal.eigen() * std::max(0.0, outside);
      returned[i] = before - q;
    }
  return Point<Patient>(q);
}

TEST(ClosestPoint, InFreeSpaceIsThePointItself) {
  const auto found = closest_point({1, 2, 3}, {});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->point, Point<Patient>(1, 2, 3));
  EXPECT_EQ(found->count, 0);
  const std::vector<HalfSpace> behind{{Vector<Patient>(0, 0, 1), 2.5}};
  EXPECT_EQ(closest_point({1, 2, 3}, behind)->point, Point<Patient>(1, 2, 3));
}

TEST(ClosestPoint, AgreesWithAlternatingProjections) {
  SCOPED_TRACE("seed " + std::to_string(kHalfSpacesSeed));
  std::mt19937 random(kHalfSpacesSeed);
  int by_count[4] = {};
  for (int n = 0; n < 4000; ++n) {
    // all half-spaces contain one point, so the intersection is not empty
    const Point<Patient> inside = random_corner(random, 1);
    std::vector<HalfSpace> half_spaces(1 + n % 5);
    for (HalfSpace& half_space : half_spaces) {
      half_space.normal = random_direction(random);
      half_space.offset =
          half_space.normal.eigen().dot(inside.eigen()) - std::abs(random_corner(random, 0.3).x());
    }
    const Point<Patient> x = random_corner(random, 3);
    const auto found = closest_point(x, half_spaces);
    ASSERT_TRUE(found) << n;
    ++by_count[found->count];
    for (const HalfSpace& half_space : half_spaces) EXPECT_GE(half_space.clearance(found->point), -1e-8);
    // the multipliers reproduce the displacement
    Vector<Patient> pull;
    for (int i = 0; i < found->count; ++i) {
      EXPECT_GT(found->multiplier_mm[i], 0);
      EXPECT_NEAR(half_spaces[found->active[i]].clearance(found->point), 0, 1e-8);
      pull += half_spaces[found->active[i]].normal * found->multiplier_mm[i];
    }
    EXPECT_LT((x + pull - found->point).norm(), 1e-9);
    // at least as near as the reference has converged to
    const Point<Patient> slow = by_dykstra(x, half_spaces, 3000);
    double outside = 0;
    for (const HalfSpace& half_space : half_spaces) outside = std::max(outside, -half_space.clearance(slow));
    if (outside < 1e-7) {
      EXPECT_LT((found->point - x).norm(), (slow - x).norm() + 1e-4) << n;
    }
  }
  for (const int count : by_count) EXPECT_GT(count, 50);
}

TEST(ClosestPoint, AcuteWedgeIsExact) {
  // two half-spaces at an angle of 10 degrees: cyclic projection would stop far from the edge
  const double half = 5 * M_PI / 180;
  const std::vector<HalfSpace> wedge{{Vector<Patient>(std::sin(half), std::cos(half), 0), 0},
                                     {Vector<Patient>(std::sin(half), -std::cos(half), 0), 0}};
  const auto found = closest_point({-2, 0.01, 7}, wedge);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->count, 2);
  EXPECT_LT((found->point - Point<Patient>(0, 0, 7)).norm(), 1e-9);
}

TEST(ClosestPoint, OppositeHalfSpacesAreInfeasibleOrAGap) {
  const auto walls = [](double gap_mm) {
    return std::vector<HalfSpace>{{Vector<Patient>(1, 0, 0), 0}, {Vector<Patient>(-1, 0, 0), -gap_mm}};
  };
  EXPECT_FALSE(closest_point({-1, 0, 0}, walls(-0.1)));
  const auto in_gap = closest_point({-1, 2, 0}, walls(0.1));
  ASSERT_TRUE(in_gap);
  EXPECT_EQ(in_gap->point, Point<Patient>(0, 2, 0));
}

TEST(ClosestPoint, DuplicateHalfSpaceCountsOnce) {
  const std::vector<HalfSpace> twice(3, {Vector<Patient>(0, 1, 0), 1});
  const auto found = closest_point({5, -1, 2}, twice);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->count, 1);
  EXPECT_EQ(found->point, Point<Patient>(5, 1, 2));
}

}  // namespace
}  // namespace palpate
