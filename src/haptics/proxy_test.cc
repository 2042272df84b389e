#include "palpate/proxy.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "haptics/proxy_test_surfaces.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::felt_surface;
using testing::ProxyRun;
using testing::random_direction;

constexpr unsigned kProxySeed = 51;
const Eigen::Vector3d kKnee_mm(0.277, 0.277, 1.0);

// everything below z = 0
double floor_mm(const Eigen::Vector3d& p) {
  return p.z();
}

ProxyRun on_floor(double friction_static = 0, double friction_dynamic = 0, double stiffness = 2) {
  ProxyRun run;
  run.surfaces = {felt_surface(cube_grid(10, {0.5, 0.5, 0.5}), floor_mm)};
  run.surfaces[0].stiffness_N_per_mm = stiffness;
  run.surfaces[0].static_friction = friction_static;
  run.surfaces[0].dynamic_friction = friction_dynamic;
  run.at({0, 0, 3});
  return run;
}

TEST(Proxy, FollowsTheTipInFreeSpace) {
  ProxyRun run = on_floor();
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> wide(-30, 30), above(0.05, 30);
  for (int n = 0; n < 1000; ++n) {
    // drawn one by one: arguments are evaluated in no certain order
    const double z = above(random), y = wide(random), x = wide(random);
    const Point<Patient> tip(x, y, z);
    // tens of millimetres in a tick, just above the floor, are more strides than a tick has: the next one
    // goes on
    for (int ticks = 0; ticks == 0 || (run.result.lagging && ticks < 5); ++ticks) {
      run.at(tip);
      EXPECT_EQ(run.result.force_N, Vector<Patient>());
      EXPECT_EQ(run.state.contacts, 0);
    }
    EXPECT_EQ(run.state.position, tip);
  }
}

TEST(Proxy, FollowsAHandAtOnceInFreeSpace) {
  // up to 2.8 m/s, down to where a surface becomes a wall
  ProxyRun run = on_floor();
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> aside(-0.7, 0.7), above(0.06, 2);
  Point<Patient> tip(0, 0, 1);
  run.at(tip);
  for (int n = 0; n < 10'000; ++n) {
    const double x = aside(random), y = aside(random), z = above(random);
    tip = {x, y, z};
    run.at(tip);
    // ways of less are none
    EXPECT_LT((run.state.position - tip).norm(), 2e-5);
    EXPECT_FALSE(run.result.lagging);
  }
}

TEST(Proxy, PressesBackWithTheStiffnessFromAnyRadius) {
  for (const double radius_mm : {0.0, 0.5, 1.5, 3.0}) {
    ProxyRun run = on_floor();
    run.spheres = {{{}, radius_mm}};
    run.at({1, 2, 5});
    for (const double depth_mm : {0.1, 1.0, 3.7}) {
      run.lead(run.state.position, {1, 2, radius_mm - depth_mm}, 0.3);
      EXPECT_NEAR(run.result.force_N.z(), 2 * depth_mm, 2e-3);
      EXPECT_NEAR(run.state.position.z(), radius_mm, 1e-3);
      EXPECT_LT(std::hypot(run.result.force_N.x(), run.result.force_N.y()), 1e-6);
      EXPECT_LT(run.result.torque_Nmm.norm(), 1e-6) << "the force goes through the tip";
      ASSERT_EQ(run.state.contacts, 1);
      EXPECT_EQ(run.state.contact[0].surface, 0);
    }
    EXPECT_LT(run.deepest_mm, kMostDip_mm);
  }
}

TEST(Proxy, SlidesWithoutFrictionStraightUnderTheTip) {
  ProxyRun run = on_floor();
  run.lead({-4, 0, 1}, {-4, 0, -1}, 0.1);
  run.lead({-4, 0, -1}, {4, 3, -1}, 0.5);
  EXPECT_NEAR(run.state.position.x(), 4, 1e-3);
  EXPECT_NEAR(run.state.position.y(), 3, 1e-3);
  run.lead({4, 3, -1}, {4, 3, 1}, 0.1);
  EXPECT_EQ(run.state.contacts, 0) << "let go";
  EXPECT_EQ(run.state.position, Point<Patient>(4, 3, 1));
}

// both ends outside, the plate between them
TEST(Proxy, NeverPassesAThinPlateHoweverFastTheTip) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> thick(1.2, 2.2), unit(0, 1);
  for (int n = 0; n < 60; ++n) {
    const Vector<Patient> across = random_direction(random);
    const double half_mm = 0.5 * thick(random);
    const auto turned = Eigen::AngleAxisd(2 * unit(random), random_direction(random).eigen());
    ProxyRun run;
    run.surfaces = {
        felt_surface(cube_grid(9, kKnee_mm, turned.toRotationMatrix()),
                     [&](const Eigen::Vector3d& p) { return std::abs(across.eigen().dot(p)) - half_mm; })};
    const double radius_mm = n % 3 == 0 ? 0 : unit(random);
    run.spheres = {{{}, radius_mm}};
    const Point<Patient> start = Point<Patient>() + across * 4;
    run.at(start);
    // at once and in steps of half a millimetre
    run.lead(start, Point<Patient>() - across * 3, n % 2 == 0 ? 10 : 0.5);
    for (int settle = 0; settle < 10; ++settle) run.at(Point<Patient>() - across * 3);
    EXPECT_GT(run.state.position.eigen().dot(across.eigen()), 0);
    EXPECT_GE(run.state.contacts, 1);
    EXPECT_LT(run.deepest_mm, kMostDip_mm) << n;
  }
}

TEST(Proxy, HoldsInACornerAndInAnAcuteWedge) {
  for (const double degrees : {90.0, 40.0, 20.0}) {
    SCOPED_TRACE(degrees);
    // a groove along y, open upwards: two walls of one structure
    const double half = 0.5 * degrees * M_PI / 180;
    ProxyRun run;
    run.surfaces = {felt_surface(cube_grid(9, {0.3, 0.3, 0.3}), [&](const Eigen::Vector3d& p) {
      return std::cos(half) * -std::abs(p.x()) + std::sin(half) * p.z();
    })};
    const double radius_mm = 0.6;
    run.spheres = {{{}, radius_mm}};
    run.at({0.3, 0, 8});
    run.lead({0.3, 0, 8}, {0.2, 0, -2}, 0.4);
    for (int n = 0; n < 50; ++n) run.at({0.2, 0, -2});
    // the sphere rests on both walls
    EXPECT_NEAR(run.state.position.x(), 0, 0.05);
    EXPECT_NEAR(run.state.position.z(), radius_mm / std::sin(half), 0.35);
    // where the field of a notch is narrower than its voxels, as one
    EXPECT_GE(run.state.contacts, 1);
    EXPECT_LT(run.deepest_mm, kMostDip_mm);
    // and stays where it is
    const Point<Patient> before = run.state.position;
    for (int n = 0; n < 100; ++n) run.at({0.2, 0, -2});
    EXPECT_LT((run.state.position - before).norm(), 1e-4);
  }
}

TEST(Proxy, IsHeldByThreeWallsOfThreeStructures) {
  ProxyRun run;
  for (int axis = 0; axis < 3; ++axis)
    run.surfaces.push_back(
        felt_surface(cube_grid(9, {0.5, 0.5, 0.5}), [axis](const Eigen::Vector3d& p) { return p[axis]; }));
  run.at({3, 3, 3});
  run.lead({3, 3, 3}, {-1, -2, -0.5}, 0.2);
  EXPECT_LT((run.state.position - Point<Patient>()).norm(), 2e-3);
  EXPECT_EQ(run.state.contacts, 3);
  EXPECT_LT((run.result.force_N - Vector<Patient>(1, 2, 0.5)).norm(), 5e-3);
}

TEST(Proxy, FourSpheresInACornerLeanOnAllThreeWalls) {
  // of tools that differ by micrometres, so that each sphere meets each wall
  ProxyRun run;
  for (int axis = 0; axis < 3; ++axis)
    run.surfaces.push_back(
        felt_surface(cube_grid(9, {0.5, 0.5, 0.5}), [axis](const Eigen::Vector3d& p) { return p[axis]; }));
  run.spheres.clear();
  for (const double aside_mm : {0.0, 0.001, 0.002, 0.003})
    run.spheres.push_back({Vector<Patient>(aside_mm, aside_mm, aside_mm), 1});
  run.at({3, 3, 3});
  run.lead({3, 3, 3}, {0, -1, 0.5}, 0.2);
  EXPECT_LT((run.state.position - Point<Patient>(1, 1, 1)).norm(), 4e-3);
  EXPECT_EQ(run.state.contacts, 12);
  EXPECT_FALSE(run.result.wedged);
  EXPECT_LT((run.result.force_N - Vector<Patient>(1, 2, 0.5)).norm(), 5e-3);
  Vector<Patient> pull_mm;
  for (int n = 0; n < run.state.contacts; ++n)
    pull_mm += run.state.contact[static_cast<std::size_t>(n)].normal *
               run.state.contact[static_cast<std::size_t>(n)].pull_mm;
  EXPECT_LT((pull_mm - Vector<Patient>(1, 2, 0.5)).norm(), 5e-3) << "and the walls give all of it";
  EXPECT_LT(run.deepest_mm, kMostDip_mm);
}

TEST(Proxy, AToolWiderThanTheGapStaysAndSaysSo) {
  ProxyRun run;
  for (const double side : {-1.0, 1.0})
    run.surfaces.push_back(felt_surface(cube_grid(9, {0.4, 0.4, 0.4}), [side](const Eigen::Vector3d& p) {
      // two balls of 4 mm, 1.5 mm apart
      return (p - Eigen::Vector3d(side * 4.75, 0, 0)).norm() - 4;
    }));
  run.spheres = {{{}, 1.5}};
  run.at({0, 0, 7});
  run.lead({0, 0, 7}, {0, 0, -1}, 0.2);
  for (int n = 0; n < 100; ++n) run.at({0, 0, -1});
  // where the centres of tool and balls are 5.5 mm apart
  EXPECT_NEAR(run.state.position.z(), std::sqrt(5.5 * 5.5 - 4.75 * 4.75), 0.08);
  EXPECT_GT(run.result.force_N.z(), 0);
  EXPECT_LT(run.deepest_mm, kMostDip_mm);
}

TEST(Proxy, AToolThatTurnsIntoAGapThatIsTooNarrowIsFoundAgainWhenItsTipIsFree) {
  // a floor and a ceiling 2 mm apart, and a tool that grows too tall for them
  ProxyRun run;
  run.surfaces = {
      felt_surface(cube_grid(9, {0.5, 0.5, 0.5}), floor_mm),
      felt_surface(cube_grid(9, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return 2 - p.z(); })};
  run.spheres = {{Vector<Patient>(0, 0, 0.5), 0.4}, {Vector<Patient>(0, 0, -0.5), 0.4}};
  run.at({0, 0, 1});
  EXPECT_TRUE(run.state.coupled);
  run.spheres = {{Vector<Patient>(0, 0, 0.9), 0.4}, {Vector<Patient>(0, 0, -0.9), 0.4}};
  const Point<Patient> stays = run.state.position;
  for (int n = 0; n < 20; ++n) {
    run.at({0, 0, 0.8});
    EXPECT_TRUE(run.result.wedged);
    EXPECT_EQ(run.state.position, stays);
    EXPECT_EQ(run.result.force_N, Vector<Patient>()) << "which way would be a guess";
  }
  run.spheres = {{Vector<Patient>(0, 0, 0.5), 0.4}, {Vector<Patient>(0, 0, -0.5), 0.4}};
  run.at({0, 0, 1});
  EXPECT_FALSE(run.result.wedged);
  EXPECT_EQ(run.state.position, Point<Patient>(0, 0, 1));
  EXPECT_LT(run.deepest_mm, kMostDip_mm);
}

TEST(Proxy, SpheresThatATurnPutsALittleBelowAreTakenBackWithoutMeetingAnotherWall) {
  ProxyRun run;
  run.surfaces = {
      felt_surface(cube_grid(9, {0.5, 0.5, 0.5}), floor_mm),
      felt_surface(cube_grid(9, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return 2 - p.z(); })};
  run.spheres = {{Vector<Patient>(2, 0, 0), 0.5}, {Vector<Patient>(-2, 0, 0), 0.5}};
  run.at({0, 0, 1});
  for (int n = 1; n <= 40; ++n) {
    // one sphere goes down and the other up, by 10 micrometres a tick
    run.spheres[0].offset_mm = Vector<Patient>(2, 0, -0.01 * n);
    run.spheres[1].offset_mm = Vector<Patient>(-2, 0, 0.01 * n);
    run.at({0, 0, 0.7});
    ASSERT_FALSE(run.result.wedged) << n;
    ASSERT_LT(run.deepest_mm, kMostDip_mm) << n;
  }
}

TEST(Proxy, ALayerThatWasGoneThroughDoesNotCloseRoundTheProxy) {
  // cartilage of 2 mm on bone
  ProxyRun run;
  run.surfaces = {felt_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                               [](const Eigen::Vector3d& p) { return std::abs(p.z() - 1) - 1; }),
                  felt_surface(cube_grid(9, {0.5, 0.5, 0.5}), floor_mm)};
  run.surfaces[0].puncture_N = 1;
  for (const double radius_mm : {0.0, 0.5}) {
    run.spheres = {{{}, radius_mm}};
    run.state = {};
    run.at({0, 0, 5});
    run.lead({0, 0, 5}, {0, 0, -1.5}, 0.05);
    EXPECT_EQ(run.state.punctured, SurfaceSet(1));
    EXPECT_NEAR(run.state.position.z(), radius_mm, 0.02) << "through the cartilage, held by the bone";
    run.lead({0, 0, -1.5}, {0, 0, 5}, 0.05);
    EXPECT_EQ(run.state.position, Point<Patient>(0, 0, 5)) << "let out again";
    EXPECT_EQ(run.state.punctured, SurfaceSet());
    EXPECT_EQ(run.result.force_N, Vector<Patient>());
  }
}

// how evenly the force changes while the tip slides slowly, deep below a surface
void expect_even(ProxyRun& run, const std::function<Point<Patient>(double)>& tip_at, double step) {
  run.at(tip_at(0));
  for (int n = 0; n < 50; ++n) run.at(tip_at(0));
  Vector<Patient> before = run.result.force_N;
  Point<Patient> proxy = run.state.position;
  double most_mm = 0, most_N = 0, way_mm = 0;
  const int ticks = 1500;
  for (int n = 1; n <= ticks; ++n) {
    run.at(tip_at(step * n));
    most_N = std::max(most_N, (run.result.force_N - before).norm());
    most_mm = std::max(most_mm, (run.state.position - proxy).norm());
    way_mm += (run.state.position - proxy).norm();
    before = run.result.force_N;
    proxy = run.state.position;
  }
  const double mean_mm = way_mm / ticks;
  EXPECT_GT(mean_mm, 1e-3) << "it slides";
  EXPECT_LT(most_mm, 4 * mean_mm + 1e-3) << "and does not leap";
  EXPECT_LT(most_N, 0.01 * 2) << "N, at 2 N/mm";
}

TEST(Proxy, SlidesEvenlyUnderASlowTip) {
  const auto run_on = [](const testing::Distance& distance_mm) {
    ProxyRun run;
    run.surfaces = {felt_surface(cube_grid(22, {0.5, 0.5, 0.5}), distance_mm)};
    run.surfaces[0].stiffness_N_per_mm = 2;
    run.at({0, 0, 21});
    return run;
  };
  // 3 micrometres a tick, 3 mm deep
  ProxyRun plane = run_on([](const Eigen::Vector3d& p) { return p.z(); });
  plane.lead({0, 0, 21}, {0, 0, -3}, 0.5);
  expect_even(
      plane, [](double way) { return Point<Patient>(way, 0.2 * way, -3); }, 0.003);
  ProxyRun ball = run_on([](const Eigen::Vector3d& p) { return p.norm() - 15; });
  ball.lead({0, 0, 21}, {0, 0, 12}, 0.5);
  expect_even(
      ball, [](double way) { return Point<Patient>(12 * std::sin(way / 12), 0, 12 * std::cos(way / 12)); },
      0.003);
  // a hollow whose bottom bends more than the tip is deep
  ProxyRun hollow = run_on([](const Eigen::Vector3d& p) { return 5 - p.tail<2>().norm(); });
  hollow.state.coupled = false;
  hollow.at({0, 0, 0});
  hollow.lead({0, 0, 0}, {0, 0, -8}, 0.2);
  expect_even(
      hollow, [](double way) { return Point<Patient>(way, 0, -8); }, 0.003);
}

TEST(Proxy, FrictionConeIsAsSet) {
  const double mu_static = 0.4, mu_dynamic = 0.25, depth_mm = 1.5;
  ProxyRun run = on_floor(mu_static, mu_dynamic);
  run.lead({0, 0, 1}, {0, 0, -depth_mm}, 0.05);
  EXPECT_TRUE(run.state.sticking);
  // pulled sideways: sticks up to the static cone, then slides on the dynamic one
  double most_ratio = 0;
  double x = 0;
  while (run.state.sticking && x < 2) {
    run.at({x += 0.001, 0, -depth_mm});
    if (run.state.sticking)
      most_ratio = std::max(most_ratio, std::abs(run.result.force_N.x()) / run.result.force_N.z());
  }
  EXPECT_NEAR(most_ratio, mu_static, 0.02 * mu_static);
  for (int n = 0; n < 1000; ++n) {
    run.at({x += 0.003, 0, -depth_mm});
    EXPECT_NEAR(-run.result.force_N.x() / run.result.force_N.z(), mu_dynamic, 0.02 * mu_dynamic);
    EXPECT_FALSE(run.state.sticking);
  }
  // stops: it sticks again, and needs the static cone to come loose
  run.at({x, 0, -depth_mm});
  run.at({x, 0, -depth_mm});
  EXPECT_TRUE(run.state.sticking);
}

// on a plane however it lies to the voxels, in any direction along it
TEST(Proxy, FrictionConeIsAsSetOnEveryPlane) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int n = 0; n < 40; ++n) {
    const Vector<Patient> up = random_direction(random);
    const Vector<Patient> along = up.cross(random_direction(random)).normalized();
    // the normal of a sampled plane is off by up to 0.6 mrad, which is 2 % of a coefficient below 0.03
    const double mu_static = 0.05 + unit(random);
    const double mu_dynamic = 0.05 + (mu_static - 0.05) * unit(random);
    const double depth_mm = 0.5 + 2 * unit(random);
    SCOPED_TRACE("plane " + std::to_string(n));
    ProxyRun run;
    run.surfaces = {
        felt_surface(cube_grid(9, kKnee_mm), [&](const Eigen::Vector3d& p) { return up.eigen().dot(p); })};
    run.surfaces[0].static_friction = mu_static;
    run.surfaces[0].dynamic_friction = mu_dynamic;
    run.spheres = {{{}, n % 2 == 0 ? 0 : 1.5 * unit(random)}};
    const double above_mm = run.spheres[0].radius_mm;
    const auto tip = [&](double way_mm, double height_mm) {
      return Point<Patient>() + along * way_mm + up * (above_mm + height_mm);
    };
    const auto ratio = [&] {
      const double normal_N = run.result.force_N.dot(up);
      return (run.result.force_N - up * normal_N).norm() / normal_N;
    };
    run.at(tip(0, 1));
    run.lead(tip(0, 1), tip(0, -depth_mm), 0.05);
    ASSERT_TRUE(run.state.sticking);
    double way_mm = 0, most_ratio = 0;
    const double stride_mm = mu_static * depth_mm / 1000;
    while (run.state.sticking && way_mm < 5) {
      most_ratio = std::max(most_ratio, ratio());
      run.at(tip(way_mm += stride_mm, -depth_mm));
    }
    EXPECT_NEAR(most_ratio, mu_static, 0.02 * mu_static);
    for (int slid = 0; slid < 300; ++slid) {
      run.at(tip(way_mm += 0.003, -depth_mm));
      ASSERT_NEAR(ratio(), mu_dynamic, 0.02 * mu_dynamic);
    }
  }
}

TEST(Proxy, DoesNotDriftWhileItSticks) {
  for (const bool curved : {false, true}) {
    ProxyRun run;
    run.surfaces = {felt_surface(cube_grid(12, kKnee_mm), [&](const Eigen::Vector3d& p) {
      return curved ? (p + Eigen::Vector3d(0, 0, 10)).norm() - 10 : p.z() + 0.2 * p.x();
    })};
    run.surfaces[0].static_friction = 0.6;
    run.surfaces[0].dynamic_friction = 0.5;
    run.at({1, 0.5, 3});
    run.lead({1, 0.5, 3}, {1, 0.5, -2}, 0.05);
    for (int n = 0; n < 20; ++n) run.at({1, 0.5, -2});
    EXPECT_TRUE(run.state.sticking);
    const Point<Patient> before = run.state.position;
    // 10 s at 1 kHz, with a tremor inside the cone
    for (int n = 0; n < 10'000; ++n)
      run.at({1 + 0.05 * std::sin(0.06 * n), 0.5 + 0.05 * std::cos(0.05 * n), -2});
    run.at({1, 0.5, -2});
    EXPECT_LT((run.state.position - before).norm(), 1e-3) << "mm";
  }
}

TEST(Proxy, AWallThatIsMetOnTheWayLetsNoFrictionGo) {
  // Stuck on a floor just before a wall, farther from it than a wall is seen, pulled into the notch and along
  // it. On the floor alone it would have to slide; the notch holds it by static friction.
  for (const double before_wall_mm : {0.055, 0.06, 0.065}) {
    SCOPED_TRACE(before_wall_mm);
    ProxyRun run = on_floor(0.8, 0.2);
    run.surfaces.push_back(
        felt_surface(cube_grid(10, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return p.x(); }));
    run.surfaces[1].static_friction = 0.8;
    run.surfaces[1].dynamic_friction = 0.2;
    run.surfaces[1].stiffness_N_per_mm = 2;
    run.lead({before_wall_mm, 0, 3}, {before_wall_mm, 0, -1}, 0.1);
    ASSERT_TRUE(run.state.sticking);
    ASSERT_EQ(run.state.contacts, 1);
    run.at({-1.5, 0.6, -1});
    EXPECT_EQ(run.state.contacts, 2);
    EXPECT_TRUE(run.state.sticking);
    EXPECT_NEAR(run.state.position.y(), 0, 1e-3);
  }
}

TEST(Proxy, ATipThatBeginsInsideIsNotHeldUntilItIsFree) {
  ProxyRun run;
  run.surfaces = {felt_surface(cube_grid(10, {0.5, 0.5, 0.5}), floor_mm)};
  for (int n = 0; n < 5; ++n) {
    run.at({0, 0, -2 + 0.3 * n});
    EXPECT_FALSE(run.state.coupled);
    EXPECT_EQ(run.result.force_N, Vector<Patient>());
  }
  run.at({0, 0, 0.5});
  EXPECT_TRUE(run.state.coupled);
  run.lead({0, 0, 0.5}, {0, 0, -1}, 0.1);
  EXPECT_GT(run.result.force_N.z(), 0.9);
}

TEST(Proxy, IsBornAtTheNearestPlaceOutsideWhenAsked) {
  ProxyRun run;
  run.surfaces = {
      felt_surface(cube_grid(12, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return p.norm() - 8; })};
  run.spheres = {{{}, 1}};
  ASSERT_TRUE(give_birth_to_proxy(run.surfaces, run.spheres, {5, 0, 0}, run.state));
  EXPECT_NEAR(run.state.position.x(), 9, 0.03);
  run.at({5, 0, 0});
  EXPECT_NEAR(run.result.force_N.x(), 4, 0.1);
  // too deep for the field to know a direction
  EXPECT_FALSE(give_birth_to_proxy(run.surfaces, run.spheres, {0.3, 0, 0}, run.state));
}

TEST(Proxy, GoesThroughAtThePunctureForceAndClosesWhenTheToolHasLeft) {
  ProxyRun run = on_floor();
  run.surfaces[0].puncture_N = 3;  // at 1.5 mm
  run.lead({0, 0, 1}, {0, 0, -1.4}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet());
  EXPECT_NEAR(run.result.force_N.z(), 2.8, 0.01);
  run.lead({0, 0, -1.4}, {0, 0, -1.6}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet(1));
  run.at({0, 0, -1.6});
  EXPECT_EQ(run.result.force_N, Vector<Patient>()) << "through";
  EXPECT_EQ(run.state.position, Point<Patient>(0, 0, -1.6));
  // moving about inside, and out
  run.lead({0, 0, -1.6}, {1, 0, -1}, 0.1);
  EXPECT_EQ(run.state.punctured, SurfaceSet(1));
  run.lead({1, 0, -1}, {1, 0, 1}, 0.1);
  EXPECT_EQ(run.state.punctured, SurfaceSet());
  run.lead({1, 0, 1}, {1, 0, -1}, 0.1);
  EXPECT_NEAR(run.result.force_N.z(), 2, 0.01) << "closed again";
}

TEST(Proxy, TwoSpheresOnAPlaneShareTheForceAndATiltedToolTurns) {
  ProxyRun run = on_floor();
  run.spheres = {{Vector<Patient>(3, 0, 0), 0.5}, {Vector<Patient>(-3, 0, 0), 0.5}};
  run.at({0, 0, 3});
  run.lead({0, 0, 3}, {0, 0, -0.5}, 0.1);
  EXPECT_EQ(run.state.contacts, 2);
  EXPECT_NEAR(run.result.force_N.z(), 2, 5e-3);
  EXPECT_LT(run.result.torque_Nmm.norm(), 1e-3) << "balanced";
  // one lower than the other: it alone bears the force, about the tip
  run.spheres[0].offset_mm = Vector<Patient>(3, 0, -0.3);
  run.at({0, 0, -0.5});
  run.at({0, 0, -0.5});
  EXPECT_EQ(run.state.contacts, 1);
  EXPECT_NEAR(run.state.position.z(), 0.8, 5e-3);
  EXPECT_NEAR(run.result.torque_Nmm.y(), -3 * run.result.force_N.z(), 1e-3) << "r x F";
}

TEST(Proxy, StiffnessIsThatOfWhatIsTouchedByItsPull) {
  ProxyRun run;
  for (int axis = 0; axis < 2; ++axis)
    run.surfaces.push_back(
        felt_surface(cube_grid(9, {0.5, 0.5, 0.5}), [axis](const Eigen::Vector3d& p) { return p[axis]; }));
  run.surfaces[0].stiffness_N_per_mm = 1;
  run.surfaces[1].stiffness_N_per_mm = 3;
  run.at({3, 3, 0});
  run.lead({3, 3, 0}, {-1, -1, 0}, 0.1);
  EXPECT_NEAR(run.result.stiffness_N_per_mm, 2, 1e-2);
  run.lead({-1, -1, 0}, {-1, 2, 0}, 0.1);
  EXPECT_NEAR(run.result.stiffness_N_per_mm, 1, 1e-9);
}

TEST(Proxy, MoreSurfacesThanOneTickLooksAtHoldTheToolToo) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  ProxyRun run;
  // a heap of balls that overlap: the tool lies on many of them
  for (int s = 0; s < 40; ++s) {
    const Eigen::Vector3d centre = random_direction(random).eigen() * 1.5;
    run.surfaces.push_back(felt_surface(
        cube_grid(7, {0.5, 0.5, 0.5}), [=](const Eigen::Vector3d& p) { return (p - centre).norm() - 2.0; },
        2));
  }
  run.spheres = {{{}, 1}};
  for (int n = 0; n < 30; ++n) {
    const Vector<Patient> side = random_direction(random);
    run.state = {};
    run.at(Point<Patient>() + side * 8);
    run.lead(run.state.position, Point<Patient>() - side * 2, 0.4);
    for (int settle = 0; settle < 30; ++settle) run.at(Point<Patient>() - side * 2);
    ASSERT_LT(run.deepest_mm, kMostDip_mm);
    EXPECT_GT(run.result.force_N.norm(), 1);
  }
}

// whatever is touched, the work of one tick is bounded and nothing is ever below by more than is allowed
TEST(Proxy, RandomWalksOverRandomSurfacesStayOutside) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> unit(0, 1), about(-1, 1);
  for (int scene = 0; scene < 24; ++scene) {
    ProxyRun run;
    const auto turned = Eigen::AngleAxisd(3 * unit(random), random_direction(random).eigen());
    for (int s = 0; s < 3; ++s) {
      // balls and rods that overlap or leave gaps, well inside their volume
      const Eigen::Vector3d centre(3 * about(random), 3 * about(random), 3 * about(random));
      const Eigen::Vector3d axis = random_direction(random).eigen();
      const double radius_mm = 1 + 2 * unit(random);
      const double half_length_mm = unit(random) < 0.5 ? 3 : 0;
      run.surfaces.push_back(felt_surface(
          cube_grid(14, kKnee_mm, turned.toRotationMatrix()),
          [=](const Eigen::Vector3d& p) {
            const Eigen::Vector3d v = p - centre;
            return (v - axis * std::clamp(axis.dot(v), -half_length_mm, half_length_mm)).norm() - radius_mm;
          },
          2));
      run.surfaces.back().static_friction = 0.3 * unit(random);
    }
    run.spheres = {{{}, 1.5 * unit(random)}};
    Point<Patient> tip(0, 0, 20);
    run.at(tip);
    ASSERT_TRUE(run.state.coupled);
    Vector<Patient> velocity_mm;
    for (int n = 0; n < 3000; ++n) {
      // half a metre a second at most at 1 kHz, drawn to the middle
      velocity_mm = velocity_mm * 0.97 + random_direction(random) * 0.06 + (Point<Patient>() - tip) * 0.002;
      if (velocity_mm.norm() > 0.5) velocity_mm = velocity_mm * (0.5 / velocity_mm.norm());
      tip += velocity_mm;
      run.at(tip);
      ASSERT_TRUE(run.result.force_N.all_finite());
      ASSERT_LT(run.deepest_mm, kMostDip_mm) << "scene " << scene << ", tick " << n;
    }
  }
}

}  // namespace
}  // namespace palpate
