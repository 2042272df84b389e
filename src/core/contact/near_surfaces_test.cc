#include "contact/near_surfaces.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <random>

#include "contact/test_proxy_surfaces.h"

/// Gathering of pairs: all that can be touched, and no others.
namespace palpate {
namespace {

using testing::cube_grid;
using testing::make_contact_surface;
using testing::random_direction;

constexpr unsigned kNearSeed = 61;

// a ball on a randomly rotated grid
ContactSurface ball_at(const Eigen::Vector3d& centre, double radius_mm, std::mt19937& random,
                       double reach_mm = 3) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(1, random_direction(random).eigen()).toRotationMatrix();
  GridGeometry grid = cube_grid(radius_mm + reach_mm + 1, {0.7, 0.7, 1.0}, turn);
  grid.origin += Vector<Patient>(centre);
  return make_contact_surface(
      grid, [&](const Eigen::Vector3d& p) { return (p - centre).norm() - radius_mm; }, reach_mm);
}

Eigen::Vector3d point_within(double half_mm, std::mt19937& random) {
  std::uniform_real_distribution<double> about(-half_mm, half_mm);
  const double x = about(random), y = about(random), z = about(random);
  return {x, y, z};
}

// clearance of a sphere, or of a capsule as the minimum of its row
double min_of_row(const Surface& surface, const ToolPart& part, const Point<Patient>& at) {
  const int steps = std::max(1, row_steps(part));
  double min_mm = std::numeric_limits<double>::infinity();
  for (int step = 0; step <= steps; ++step) {
    const Vector<Patient> offset_mm = part.offset_mm + part.axis_mm * (static_cast<double>(step) / steps);
    min_mm = std::min(min_mm, surface.distance_mm(at + offset_mm) - part.radius_mm);
  }
  return min_mm;
}

TEST(PairSet, CulledPairsAreNotReachedOnThePath) {
  SCOPED_TRACE("seed " + std::to_string(kNearSeed));
  std::mt19937 random(kNearSeed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<ContactSurface> surfaces;
  for (int s = 0; s < 60; ++s)
    surfaces.push_back(ball_at(point_within(20, random), 1 + 2 * unit(random), random));
  SurfaceSet punctured;
  punctured[7] = punctured[30] = true;
  // in another layer; covered by a surface not punctured; uncovered by a punctured one
  surfaces[12].layer = 1;
  surfaces[13].covered_by = 20;
  surfaces[14].covered_by = 30;
  int inspected = 0, cut_short = 0;
  for (int n = 0; n < 400; ++n) {
    std::vector<ToolPart> parts;
    for (int k = 0; k <= n % 4; ++k) {
      parts.push_back({Vector<Patient>(point_within(15, random)), 2.5 * unit(random)});
      if ((n + k) % 3 == 0) parts.back().axis_mm = Vector<Patient>(point_within(10, random));
    }
    const Point<Patient> at(point_within(25, random));
    const PairSet near(surfaces, parts, 0, punctured, at, 4 * unit(random));
    inspected += static_cast<int>(near.count());
    cut_short += near.count() == kMaxPairs;
    for (int m = 0; m < 10; ++m) {
      const Point<Patient> there =
          at + random_direction(random) * (near.reach_mm() * std::cbrt(unit(random)));
      for (std::size_t s = 0; s < surfaces.size(); ++s) {
        for (std::size_t k = 0; k < parts.size(); ++k) {
          bool listed = punctured[s] || s == 12 || s == 13;
          for (std::size_t i = 0; i < near.count() && !listed; ++i)
            listed = near[i].index == static_cast<int>(s) && near[i].part == static_cast<int>(k);
          if (listed) continue;
          ASSERT_GT(min_of_row(*surfaces[s].surface, parts[k], there), -1e-9);
        }
      }
    }
  }
  EXPECT_GT(inspected, 400);
  EXPECT_GT(cut_short, 0) << "more pairs than are looked at";
}

// bounds by which surfaces are excluded without a query
TEST(PairSet, BoundsAreConservative) {
  SCOPED_TRACE("seed " + std::to_string(kNearSeed));
  std::mt19937 random(kNearSeed);
  std::uniform_real_distribution<double> unit(0, 1);
  int beyond = 0, tells = 0;
  for (int s = 0; s < 20; ++s) {
    const double radius_mm = 1 + 4 * unit(random);
    const Eigen::Vector3d centre = point_within(20, random);
    const ContactSurface contact_surface = ball_at(centre, radius_mm, random, 1 + 3 * unit(random));
    const Surface& surface = *contact_surface.surface;
    for (int n = 0; n < 5000; ++n) {
      const Point<Patient> at(centre + point_within(12, random));
      const double distance_mm = surface.distance_mm(at), within_mm = 4 * unit(random);
      ASSERT_LE(surface.lower_bound_mm(at), distance_mm);
      tells += surface.lower_bound_mm(at) > 0.5;
      if (!surface.is_farther_than(at, within_mm)) continue;
      ++beyond;
      const Point<Patient> there = at + random_direction(random) * within_mm;
      ASSERT_NEAR(surface.distance_mm(there), surface.outside_mm(), 1e-9);
    }
  }
  EXPECT_GT(beyond, 1000);
  EXPECT_GT(tells, 10'000);
}

// clearances of a moving and rotating tool, with repeated queries
TEST(PairSet, ClearanceEqualsExhaustiveSearch) {
  SCOPED_TRACE("seed " + std::to_string(kNearSeed));
  std::mt19937 random(kNearSeed);
  std::uniform_real_distribution<double> unit(0, 1);
  int exact = 0, bounds = 0;
  for (int scene = 0; scene < 20; ++scene) {
    const std::vector<ContactSurface> surfaces{ball_at(point_within(4, random), 3, random),
                                               ball_at(point_within(4, random), 2, random)};
    const std::vector<ToolPart> tool{
        {Vector<Patient>(point_within(3, random)), 1, Vector<Patient>(point_within(8, random))},
        {{}, 0.3, Vector<Patient>(point_within(8, random))},
        {{}, 0.7}};
    Point<Patient> at(point_within(8, random));
    Eigen::Quaterniond attitude = Eigen::Quaterniond::Identity();
    PairSet near(surfaces, tool, 0, {}, at, 20);
    ASSERT_EQ(near.count(), 6u);
    for (int n = 0; n < 300; ++n) {
      if (n % 3 == 0)
        attitude = Eigen::AngleAxisd(0.05 * unit(random), random_direction(random).eigen()) * attitude;
      const RotatedTool turned(tool, Eigen::Quaterniond::Identity(), attitude);
      near.turn(turned.parts());
      if (n % 4 != 0) at += random_direction(random) * 0.1;
      const double cutoff_mm = n % 5 == 0 ? std::numeric_limits<double>::infinity() : 2 * unit(random);
      for (std::size_t i = 0; i < near.count(); ++i) {
        const ToolPart& part = turned.parts()[static_cast<std::size_t>(near[i].part)];
        const double min_mm = min_of_row(*near[i].surface, part, at);
        const double reported_mm = near.clearance(i, at, cutoff_mm);
        if (reported_mm <= cutoff_mm) {
          ASSERT_NEAR(reported_mm, min_mm, 1e-9);
          const Point<Patient> centre = at + near[i].offset_mm(near.step(i));
          ASSERT_NEAR(near[i].surface->distance_mm(centre) - part.radius_mm, min_mm, 1e-9);
          ++exact;
        } else {
          ASSERT_LE(reported_mm, min_mm + 1e-9);
          ASSERT_GT(min_mm, cutoff_mm - 1e-9);
          ++bounds;
        }
      }
    }
  }
  EXPECT_GT(exact, 3000);
  EXPECT_GT(bounds, 3000);
}

TEST(PairSet, FreeTestEqualsExhaustiveSearch) {
  SCOPED_TRACE("seed " + std::to_string(kNearSeed));
  std::mt19937 random(kNearSeed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<ContactSurface> surfaces;
  for (int s = 0; s < 40; ++s)
    surfaces.push_back(ball_at(point_within(20, random), 1 + 2 * unit(random), random, 1 + unit(random)));
  surfaces[12].layer = 1;
  int free = 0;
  for (int n = 0; n < 2000; ++n) {
    // radii below and above the constant distance outside the surfaces
    std::vector<ToolPart> parts{{Vector<Patient>(point_within(10, random)), 1.6 * unit(random)}, {{}, 0.5}};
    if (n % 2 == 0) parts[0].axis_mm = Vector<Patient>(point_within(6, random));
    const Point<Patient> at(point_within(30, random));
    SurfaceSet but;
    but[static_cast<std::size_t>(n % 40)] = true;
    bool expected = true;
    for (std::size_t s = 0; s < surfaces.size(); ++s)
      for (const ToolPart& part : parts)
        expected = expected && (s == 12 || but[s] ||
                                min_of_row(*surfaces[s].surface, part, at) >= -kProxySettings.outside_mm);
    ASSERT_EQ(is_free(surfaces, parts, 0, {}, but, at), expected);
    free += expected;
  }
  EXPECT_GT(free, 200);
  EXPECT_LT(free, 1800);
}

/// A tool that presses, slides and rotates among a few surfaces and punctures one of them.
class GuidedTool {
 public:
  explicit GuidedTool(std::vector<ContactSurface> surfaces) : surfaces_(std::move(surfaces)) {}
  const ProxyResult& at(const ToolPose& hand) {
    const RotatedTool tool(kTool, Eigen::Quaterniond::Identity(), hand.attitude);
    result_ = advance_proxy(surfaces_, tool.parts(), hand, state_);
    return result_;
  }
  const ProxyState& state() const { return state_; }
  // minimum duration over repetitions of one tick
  double seconds_at(const ToolPose& hand) const {
    constexpr int kRepeats = 300;
    const RotatedTool tool(kTool, Eigen::Quaterniond::Identity(), hand.attitude);
    double min_s = 1;
    for (int n = 0; n < kRepeats; ++n) {
      ProxyState state = state_;
      const auto begun = std::chrono::steady_clock::now();
      advance_proxy(surfaces_, tool.parts(), hand, state);
      min_s =
          std::min(min_s, std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count());
    }
    return min_s;
  }

  inline static const std::vector<ToolPart> kTool{
      {{}, 1}, {Vector<Patient>(3, 0, 0), 1}, {Vector<Patient>(0, 3, 0), 1}, {Vector<Patient>(12, 0, 3), 1}};

 private:
  std::vector<ContactSurface> surfaces_;
  ProxyState state_;
  ProxyResult result_;
};

std::vector<ContactSurface> few_surfaces(std::mt19937& random) {
  std::vector<ContactSurface> few{ball_at({0, 0, -6}, 6, random, 4), ball_at({9, 0, -5}, 5, random, 4),
                                  ball_at({0, 9, -4}, 4, random, 4)};
  few[2].puncture_N = 1.5;
  few[0].static_friction = few[0].friction = 0.2;
  return few;
}

std::vector<ContactSurface> with_far_ones(std::vector<ContactSurface> surfaces, std::size_t all,
                                          std::mt19937& random) {
  while (surfaces.size() < all) {
    const Eigen::Vector3d away = random_direction(random).eigen() * 60;
    surfaces.push_back(ball_at(away, 2, random, 1.5));
  }
  return surfaces;
}

// bit-identical, forces included
TEST(PairSet, DistantStructuresHaveNoEffect) {
  SCOPED_TRACE("seed " + std::to_string(kNearSeed));
  std::mt19937 random(kNearSeed);
  const auto few = few_surfaces(random);
  GuidedTool alone(few), among(with_far_ones(few, 250, random));
  Point<Patient> tip(2, 2, 8);
  Vector<Patient> velocity_mm;
  bool touched = false, punctured = false;
  for (int n = 0; n < 4000; ++n) {
    // up to 3 mm per tick
    velocity_mm = velocity_mm * 0.9 + random_direction(random) * 0.3 + (Point<Patient>(2, 2, 0) - tip) * 0.01;
    tip += velocity_mm;
    const ToolPose hand(
        tip, Eigen::Quaterniond(Eigen::AngleAxisd(0.5 * std::sin(0.01 * n), Eigen::Vector3d(0, 0.6, 0.8))));
    const ProxyResult &a = alone.at(hand), &b = among.at(hand);
    ASSERT_EQ(a.force_N, b.force_N) << n;
    ASSERT_EQ(a.torque_Nmm, b.torque_Nmm) << n;
    ASSERT_EQ(a.lagging, b.lagging) << n;
    ASSERT_EQ(alone.state().position, among.state().position) << n;
    ASSERT_EQ(alone.state().attitude.coeffs(), among.state().attitude.coeffs()) << n;
    ASSERT_EQ(alone.state().punctured, among.state().punctured) << n;
    touched = touched || a.force_N.norm() > 1;
    punctured = punctured || alone.state().punctured.any();
  }
  EXPECT_TRUE(touched);
  EXPECT_TRUE(punctured);
}

TEST(PairSet, EvaluatesOnlyNearbyPairs) {
  SCOPED_TRACE("seed " + std::to_string(kNearSeed));
  std::mt19937 random(kNearSeed);
  const auto few = few_surfaces(random), many = with_far_ones(few, 250, random);
  int requested = 0;
  for (int n = 0; n < 200; ++n) {
    const Point<Patient> at(point_within(12, random));
    const PairSet alone(few, GuidedTool::kTool, 0, {}, at, 3), among(many, GuidedTool::kTool, 0, {}, at, 3);
    ASSERT_EQ(alone.queries(), among.queries());
    ASSERT_EQ(alone.count(), among.count());
    ASSERT_GE(alone.queries(), static_cast<int>(alone.count()));
    requested += alone.queries();
  }
  EXPECT_GT(requested, 200);
  EXPECT_LT(requested, 200 * 12) << "of these pairs some are too far, too";
}

TEST(PairSet, CostDependsOnNearbyPairsOnly) {
  std::mt19937 random(kNearSeed);
  const auto few = few_surfaces(random);
  GuidedTool alone(few), among(with_far_ones(few, 250, random));
  // pressing, where the path to be searched is long
  for (int n = 0; n < 60; ++n)
    for (GuidedTool* run : {&alone, &among}) run->at(Point<Patient>(0, 0, 3 - 0.05 * n));
  const Point<Patient> pressed(0, 0, -0.1);
  // 1000 pairs instead of 12
  EXPECT_LT(among.seconds_at(pressed), 4 * alone.seconds_at(pressed));
}

}  // namespace
}  // namespace palpate
