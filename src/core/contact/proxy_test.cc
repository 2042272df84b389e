#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <random>

#include "contact/test_proxy_floor.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::floor_mm;
using testing::kKnee_mm;
using testing::kProxySeed;
using testing::labelled;
using testing::largest_change_N;
using testing::make_contact_surface;
using testing::on_floor;
using testing::ProxyRun;
using testing::random_direction;

TEST(Proxy, FollowsTheTipInFreeSpace) {
  ProxyRun run = on_floor();
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> wide(-30, 30), above(0.05, 30);
  for (int n = 0; n < 1000; ++n) {
    // drawn in separate statements, because the order in which arguments are evaluated is unspecified
    const double z = above(random), y = wide(random), x = wide(random);
    const Point<Patient> tip(x, y, z);
    // tens of millimetres per tick just above the floor need more substeps than a tick allows: the next tick
    // continues
    for (int ticks = 0; ticks == 0 || (run.result.lagging && ticks < 5); ++ticks) {
      run.at(tip);
      EXPECT_EQ(run.result.force_N, Vector<Patient>());
      EXPECT_EQ(run.state.contact_count, 0);
    }
    EXPECT_EQ(run.state.position, tip);
  }
}

TEST(Proxy, FollowsTheToolAtOnceInFreeSpace) {
  // up to 2.8 m/s, down to the distance at which a surface becomes a constraint
  ProxyRun run = on_floor();
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> lateral(-0.7, 0.7), above(0.06, 2);
  Point<Patient> tip(0, 0, 1);
  run.at(tip);
  for (int n = 0; n < 10'000; ++n) {
    const double x = lateral(random), y = lateral(random), z = above(random);
    tip = {x, y, z};
    run.at(tip);
    // below the threshold of rest
    EXPECT_LT((run.state.position - tip).norm(), 2e-5);
    EXPECT_FALSE(run.result.lagging);
  }
}

TEST(Proxy, RendersTissueStiffnessForAnyRadius) {
  for (const double radius_mm : {0.0, 0.5, 1.5, 3.0}) {
    ProxyRun run = on_floor();
    run.parts = {{{}, radius_mm}};
    run.at({1, 2, 5});
    for (const double depth_mm : {0.1, 1.0, 3.7}) {
      run.lead(run.state.position, {1, 2, radius_mm - depth_mm}, 0.3);
      EXPECT_NEAR(run.result.force_N.z(), 2 * depth_mm, 2e-3);
      EXPECT_NEAR(run.state.position.z(), radius_mm, 1e-3);
      EXPECT_LT(std::hypot(run.result.force_N.x(), run.result.force_N.y()), 1e-6);
      EXPECT_LT(run.result.torque_Nmm.norm(), 1e-6) << "the force goes through the tip";
      ASSERT_EQ(run.state.contact_count, 1);
      EXPECT_EQ(run.state.contacts[0].surface, 0);
    }
    EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
  }
}

TEST(Proxy, WithoutFrictionStaysAboveTheTip) {
  ProxyRun run = on_floor();
  run.lead({-4, 0, 1}, {-4, 0, -1}, 0.1);
  run.lead({-4, 0, -1}, {4, 3, -1}, 0.5);
  EXPECT_NEAR(run.state.position.x(), 4, 1e-3);
  EXPECT_NEAR(run.state.position.y(), 3, 1e-3);
  run.lead({4, 3, -1}, {4, 3, 1}, 0.1);
  EXPECT_EQ(run.state.contact_count, 0) << "let go";
  EXPECT_EQ(run.state.position, Point<Patient>(4, 3, 1));
}

// both end points outside, the plate between them
TEST(Proxy, NeverPassesAThinPlateAtAnySpeed) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> thick(1.2, 2.2), unit(0, 1);
  for (int n = 0; n < 60; ++n) {
    const Vector<Patient> across = random_direction(random);
    const double half_mm = 0.5 * thick(random);
    const auto turned = Eigen::AngleAxisd(2 * unit(random), random_direction(random).eigen());
    ProxyRun run;
    run.surfaces = {make_contact_surface(
        cube_grid(9, kKnee_mm, turned.toRotationMatrix()),
        [&](const Eigen::Vector3d& p) { return std::abs(across.eigen().dot(p)) - half_mm; })};
    const double radius_mm = n % 3 == 0 ? 0 : unit(random);
    run.parts = {{{}, radius_mm}};
    const Point<Patient> start = Point<Patient>() + across * 4;
    run.at(start);
    // in one tick, and in steps of half a millimetre
    run.lead(start, Point<Patient>() - across * 3, n % 2 == 0 ? 10 : 0.5);
    for (int settle = 0; settle < 10; ++settle) run.at(Point<Patient>() - across * 3);
    EXPECT_GT(run.state.position.eigen().dot(across.eigen()), 0);
    EXPECT_GE(run.state.contact_count, 1);
    EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm) << n;
  }
}

// A tip that emerges from a plate on the negative side of x, with its proxy on the other side.
ProxyRun proxy_behind_a_plate(const Point<Patient>& free_tip, double second_plate_mm) {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(9, kKnee_mm), [&](const Eigen::Vector3d& p) {
    return std::min(std::abs(p.x()) - 1, std::abs(p.x() - second_plate_mm) - 0.6);
  })};
  run.at({3, 0, 0});
  run.lead({3, 0, 0}, {0.5, 0, 0}, 0.02);
  run.state.free_tip = free_tip;
  run.lead({0.5, 0, 0}, {-2, 0, 0}, 0.02);
  return run;
}

TEST(Proxy, ReleasesAToolThatReturnedToFreeSpace) {
  ProxyRun run = proxy_behind_a_plate({-3, 1, 0}, 8);
  EXPECT_EQ(run.state.position, Point<Patient>(-2, 0, 0));
  EXPECT_EQ(run.state.contact_count, 0);
  // the spring force at which the tip cleared the plate fades
  double force_N = run.result.release.force_N.norm();
  EXPECT_GT(force_N, 1.5);
  const double slip_N = kProxySettings.max_slip_N_per_s * run.dt_s;
  for (; force_N > 0; force_N = run.result.force_N.norm()) {
    EXPECT_EQ(run.result.force_N, run.result.release.force_N);
    run.at({-2, 0, 0});
    ASSERT_NEAR(run.result.force_N.norm(), std::max(0.0, force_N - slip_N), 1e-9);
  }
}

// the tip stays in place while the end of a lever rotates to the other side of a plate and back
TEST(Proxy, ConstrainsALeverUntilItRotatesBack) {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(9, kKnee_mm),
                                       [](const Eigen::Vector3d& p) { return std::abs(p.z()) - 1; })};
  run.parts = {{{}, 0.3}, {{5, 0, 0}, 0.5}};
  const Point<Patient> tip(-2, 0, 2);
  const auto turn = [&](double from_rad, double to_rad) {
    for (int n = 1; n <= 200; ++n)
      run.at(tip, Eigen::Quaterniond(
                      Eigen::AngleAxisd(from_rad + (to_rad - from_rad) * n / 200, Eigen::Vector3d::UnitY())));
  };
  turn(0, 0.95);
  EXPECT_LT(tip.z() - 5 * std::sin(0.95) + 0.5, -1 - kProxySettings.withdrawal_clearance_mm)
      << "it is through";
  EXPECT_GT(run.result.force_N.norm(), 1);
  EXPECT_GE(run.state.contact_count, 1);
  turn(0.95, 0);
  EXPECT_EQ(run.result.force_N, Vector<Patient>());
}

TEST(Proxy, ConstrainsAToolThatExitedOnAnotherSide) {
  // back at the start, or with an obstacle on the path to it
  for (const Point<Patient>& free_tip : {Point<Patient>(3, 0, 0), Point<Patient>(-6, 0, 0)}) {
    ProxyRun run = proxy_behind_a_plate(free_tip, -4);
    for (int settle = 0; settle < 500; ++settle) run.at({-2, 0, 0});
    EXPECT_NEAR(run.state.position.x(), 1, 0.01);
    EXPECT_NEAR(run.result.force_N.x(), 3, 0.01);
    EXPECT_EQ(run.result.release.force_N, Vector<Patient>());
  }
}

TEST(Proxy, IsConstrainedInACornerAndAnAcuteWedge) {
  for (const double degrees : {90.0, 40.0, 20.0}) {
    SCOPED_TRACE(degrees);
    // a groove along y, open upwards: two walls of one structure
    const double half = 0.5 * degrees * M_PI / 180;
    ProxyRun run;
    run.surfaces = {make_contact_surface(cube_grid(9, {0.3, 0.3, 0.3}), [&](const Eigen::Vector3d& p) {
      return std::cos(half) * -std::abs(p.x()) + std::sin(half) * p.z();
    })};
    const double radius_mm = 0.6;
    run.parts = {{{}, radius_mm}};
    run.at({0.3, 0, 8});
    run.lead({0.3, 0, 8}, {0.2, 0, -2}, 0.4);
    for (int n = 0; n < 50; ++n) run.at({0.2, 0, -2});
    // the sphere touches both walls
    EXPECT_NEAR(run.state.position.x(), 0, 0.05);
    EXPECT_NEAR(run.state.position.z(), radius_mm / std::sin(half), 0.35);
    // one contact suffices where the notch is narrower than the voxels
    EXPECT_GE(run.state.contact_count, 1);
    EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
    // it stays at rest
    const Point<Patient> before = run.state.position;
    for (int n = 0; n < 100; ++n) run.at({0.2, 0, -2});
    EXPECT_LT((run.state.position - before).norm(), 1e-4);
  }
}

TEST(Proxy, IsConstrainedByThreeStructures) {
  ProxyRun run;
  for (int axis = 0; axis < 3; ++axis)
    run.surfaces.push_back(make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                                [axis](const Eigen::Vector3d& p) { return p[axis]; }));
  run.at({3, 3, 3});
  run.lead({3, 3, 3}, {-1, -2, -0.5}, 0.2);
  EXPECT_LT((run.state.position - Point<Patient>()).norm(), 2e-3);
  EXPECT_EQ(run.state.contact_count, 3);
  EXPECT_LT((run.result.force_N - Vector<Patient>(1, 2, 0.5)).norm(), 5e-3);
}

TEST(Proxy, FourSpheresInACornerTouchAllThreeFaces) {
  // tools whose spheres differ by micrometres, so that each touches each wall
  ProxyRun run;
  for (int axis = 0; axis < 3; ++axis)
    run.surfaces.push_back(make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                                [axis](const Eigen::Vector3d& p) { return p[axis]; }));
  run.parts.clear();
  for (const double lateral_mm : {0.0, 0.001, 0.002, 0.003})
    run.parts.push_back({Vector<Patient>(lateral_mm, lateral_mm, lateral_mm), 1});
  run.at({3, 3, 3});
  run.lead({3, 3, 3}, {0, -1, 0.5}, 0.2);
  EXPECT_LT((run.state.position - Point<Patient>(1, 1, 1)).norm(), 4e-3);
  EXPECT_EQ(run.state.contact_count, 12);
  EXPECT_FALSE(run.result.wedged);
  EXPECT_LT((run.result.force_N - Vector<Patient>(1, 2, 0.5)).norm(), 5e-3);
  Vector<Patient> multiplier_mm;
  for (int n = 0; n < run.state.contact_count; ++n)
    multiplier_mm += run.state.contacts[static_cast<std::size_t>(n)].normal *
                     run.state.contacts[static_cast<std::size_t>(n)].multiplier_mm;
  EXPECT_LT((multiplier_mm - Vector<Patient>(1, 2, 0.5)).norm(), 5e-3) << "and the walls give all of it";
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
}

TEST(Proxy, ToolWiderThanAGapStaysOutAndIsFlagged) {
  ProxyRun run;
  for (const double side : {-1.0, 1.0})
    run.surfaces.push_back(
        make_contact_surface(cube_grid(9, {0.4, 0.4, 0.4}), [side](const Eigen::Vector3d& p) {
          // two balls of 4 mm radius, 1.5 mm apart
          return (p - Eigen::Vector3d(side * 4.75, 0, 0)).norm() - 4;
        }));
  run.parts = {{{}, 1.5}};
  run.at({0, 0, 7});
  run.lead({0, 0, 7}, {0, 0, -1}, 0.2);
  for (int n = 0; n < 100; ++n) run.at({0, 0, -1});
  // centres of tool and balls are 5.5 mm apart
  EXPECT_NEAR(run.state.position.z(), std::sqrt(5.5 * 5.5 - 4.75 * 4.75), 0.08);
  EXPECT_GT(run.result.force_N.z(), 0);
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
}

TEST(Proxy, WedgedTurningToolRecoversWhenItsTipIsFree) {
  // floor and ceiling 2 mm apart, and a tool that grows taller than the gap
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}), floor_mm),
                  make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                       [](const Eigen::Vector3d& p) { return 2 - p.z(); })};
  run.parts = {{Vector<Patient>(0, 0, 0.5), 0.4}, {Vector<Patient>(0, 0, -0.5), 0.4}};
  run.at({0, 0, 1});
  EXPECT_TRUE(run.state.coupled);
  run.parts = {{Vector<Patient>(0, 0, 0.9), 0.4}, {Vector<Patient>(0, 0, -0.9), 0.4}};
  const Point<Patient> stays = run.state.position;
  for (int n = 0; n < 20; ++n) {
    run.at({0, 0, 0.8});
    EXPECT_TRUE(run.result.wedged);
    EXPECT_EQ(run.state.position, stays);
    EXPECT_EQ(run.result.force_N, Vector<Patient>()) << "which way would be a guess";
  }
  run.parts = {{Vector<Patient>(0, 0, 0.5), 0.4}, {Vector<Patient>(0, 0, -0.5), 0.4}};
  run.at({0, 0, 1});
  EXPECT_FALSE(run.result.wedged);
  EXPECT_EQ(run.state.position, Point<Patient>(0, 0, 1));
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
}

TEST(Proxy, SlightPenetrationByRotationIsCorrectedWithoutANewConstraint) {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}), floor_mm),
                  make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                       [](const Eigen::Vector3d& p) { return 2 - p.z(); })};
  run.parts = {{Vector<Patient>(2, 0, 0), 0.5}, {Vector<Patient>(-2, 0, 0), 0.5}};
  run.at({0, 0, 1});
  for (int n = 1; n <= 40; ++n) {
    // one sphere moves down and the other up by 10 micrometres per tick
    run.parts[0].offset_mm = Vector<Patient>(2, 0, -0.01 * n);
    run.parts[1].offset_mm = Vector<Patient>(-2, 0, 0.01 * n);
    run.at({0, 0, 0.7});
    ASSERT_FALSE(run.result.wedged) << n;
    ASSERT_LT(run.deepest_mm, kProxySettings.max_penetration_mm) << n;
  }
}

TEST(Proxy, PuncturedLayerStaysOpenAroundTheProxy) {
  // cartilage of 2 mm on bone
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                       [](const Eigen::Vector3d& p) { return std::abs(p.z() - 1) - 1; }),
                  make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}), floor_mm)};
  run.surfaces[0].puncture_N = 1;
  for (const double radius_mm : {0.0, 0.5}) {
    run.parts = {{{}, radius_mm}};
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

// a membrane 1 mm thick with free space below
ProxyRun on_membrane() {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                       [](const Eigen::Vector3d& p) { return std::abs(p.z()) - 0.5; })};
  run.surfaces[0].stiffness_N_per_mm = 2;
  run.surfaces[0].puncture_N = 1;
  run.surfaces[0].stays_open = true;
  run.parts = {{{}, 0.5}};
  run.at({0, 0, 4});
  return run;
}

// maximum force on a path that begins and ends in free space
double force_through_N(ProxyRun& run, const Point<Patient>& from, const Point<Patient>& to) {
  run.lead(run.state.position, from, 0.05);
  EXPECT_TRUE(run.state.punctured.none());
  const int steps = 200;
  double max_N = 0;
  for (int n = 1; n <= steps; ++n)
    max_N = std::max(max_N, run.at(from + (to - from) * (static_cast<double>(n) / steps)).force_N.norm());
  return max_N;
}

TEST(Proxy, OpenHoleAdmitsTheToolFromBothSidesOnly) {
  ProxyRun run = on_membrane();
  EXPECT_NEAR(force_through_N(run, {0, 0, 4}, {0, 0, -4}), 1, 0.1);
  ASSERT_EQ(run.holes.all().size(), 1u);
  EXPECT_NEAR(run.holes.all()[0].length_mm, 2.2, 0.1)
      << "the membrane, the tool's own width, and what it is off when it counts as out";
  // force of the tick in which it touches the rim
  constexpr double kOneStep_N = 0.1;
  EXPECT_LT(force_through_N(run, {0, 0, -4}, {0, 0, 4}), kOneStep_N) << "back";
  EXPECT_LT(force_through_N(run, {0.3, 0.2, 4}, {0.3, 0.2, -4}), kOneStep_N) << "a little aside";
  EXPECT_NEAR(force_through_N(run, {3, 0, -4}, {3, 0, 4}), 1, 0.1) << "from beneath, elsewhere";
  EXPECT_EQ(run.holes.all().size(), 2u);
  EXPECT_LT(force_through_N(run, {3, 0, 4}, {3, 0, -4}), kOneStep_N);
  EXPECT_LT(force_through_N(run, {0, 0, -4}, {0, 0, 4}), kOneStep_N) << "the first one is still there";
  EXPECT_EQ(run.holes.all().size(), 2u);
}

TEST(Proxy, HoleAdmitsToolsUpToItsWidth) {
  ProxyRun run = on_membrane();
  force_through_N(run, {0, 0, 4}, {0, 0, -4});
  force_through_N(run, {0, 0, -4}, {0, 0, 4});
  run.parts = {{{}, 0.8}};
  EXPECT_NEAR(force_through_N(run, {0, 0, 4}, {0, 0, -4}), 1, 0.1) << "wider";
  run.parts = {{{}, 0}};
  EXPECT_LT(force_through_N(run, {0.5, 0, -4}, {0.5, 0, 4}), 0.1) << "a point, within";
}

TEST(Proxy, TwoPartToolPassesThroughItsTwoHoles) {
  ProxyRun run = on_membrane();
  run.parts = {{Vector<Patient>(-1.5, 0, 0), 0.5}, {Vector<Patient>(1.5, 0, 0), 0.5}};
  run.at({0, 0, 4});
  force_through_N(run, {0, 0, 4}, {0, 0, -4});
  EXPECT_EQ(run.holes.all().size(), 2u);
  EXPECT_LT(force_through_N(run, {0, 0, -4}, {0, 0, 4}), 0.1);
  // one part over a hole, the other beside it
  EXPECT_NEAR(force_through_N(run, {3, 0, 4}, {3, 0, -4}), 1, 0.1);
}

TEST(Proxy, ClosedPunctureRequiresTheForceAgain) {
  ProxyRun run = on_membrane();
  run.surfaces[0].stays_open = false;
  for (int n = 0; n < 2; ++n) {
    EXPECT_NEAR(force_through_N(run, {0, 0, 4}, {0, 0, -4}), 1, 0.1);
    EXPECT_NEAR(force_through_N(run, {0, 0, -4}, {0, 0, 4}), 1, 0.1);
  }
  EXPECT_TRUE(run.holes.empty());
}

TEST(Proxy, SlidingToolEntersAnOpenHole) {
  ProxyRun run = on_membrane();
  force_through_N(run, {0, 0, 4}, {0, 0, -4});
  force_through_N(run, {0, 0, -4}, {0, 0, 4});
  run.lead({0, 0, 4}, {-4, 0, 4}, 0.05);
  run.lead({-4, 0, 4}, {-4, 0, 0.7}, 0.05);
  EXPECT_NEAR(run.result.force_N.z(), 0.6, 0.05) << "held by the membrane";
  bool went_in = false;
  for (int n = 0; n < 100 && !went_in; ++n) {
    const double x = -4 + 0.05 * n;
    run.at({x, 0, 0.7});
    went_in = run.state.punctured.any();
    if (!went_in) {
      EXPECT_LT(x, -0.4);
    }
  }
  EXPECT_TRUE(went_in);
  run.at(run.state.tip);
  EXPECT_EQ(run.result.force_N, Vector<Patient>());
}

// A floor of two structures that meet at x = 0, 1 and 0.4 N/mm, with friction.
ProxyRun two_settings() {
  const GridGeometry grid = cube_grid(9, {0.36, 0.36, 0.7});
  ProxyRun run;
  run.surfaces.resize(2);
  run.surfaces[0].stiffness_N_per_mm = 1;
  run.surfaces[0].static_friction = run.surfaces[0].friction = 0.2;
  run.surfaces[1].stiffness_N_per_mm = 0.4;
  run.surfaces[1].static_friction = run.surfaces[1].friction = 0.1;
  run.surfaces.push_back(make_contact_surface(grid, floor_mm));
  run.surfaces[0].covered_by = run.surfaces[1].covered_by = 2;
  run.surfaces[2].owners = std::make_shared<const Owners>(
      labelled(grid,
               [](const Eigen::Vector3d& p) {
                 return static_cast<LabelId>(p.z() >= 0 ? 0 : p.x() < 0 ? 1 : 2);
               }),
      std::vector<std::int16_t>{-1, 0, 1});
  return run;
}

TEST(Proxy, ContactPropertiesBlendAcrossASeam) {
  ProxyRun run = two_settings();
  for (const double radius_mm : {0.0, 1.5}) {
    run.parts = {{{}, radius_mm}};
    run.state = {};
    run.at({-5, 0, 5});
    run.lead({-5, 0, 5}, {-5, 0, radius_mm - 1}, 0.05);
    run.lead({-5, 0, radius_mm - 1}, {-4.5, 0, radius_mm - 1}, 0.01);
    EXPECT_NEAR(run.result.force_N.z(), 1, 0.01);
    EXPECT_NEAR(-run.result.force_N.x(), 0.2, 0.005);
    ASSERT_EQ(run.result.path_segments, 1);
    EXPECT_EQ(run.result.path[0].structure, 0);
    constexpr double kStep = 0.01;
    double before_N = run.result.force_N.norm();
    for (double x = -4.5; x <= 4.5; x += kStep) {
      const ProxyResult& result = run.at({x, 0, radius_mm - 1});
      EXPECT_LT(std::abs(result.force_N.norm() - before_N), kStep * 0.6 * 1.2 / Owners::kReach_mm + 1e-3)
          << x;
      double all = 0, all_mm = 0;
      for (int n = 0; n < result.path_segments; ++n) {
        all += result.path[static_cast<std::size_t>(n)].fraction;
        all_mm += result.path[static_cast<std::size_t>(n)].depth_mm;
      }
      EXPECT_NEAR(all, 1, kContactSettings.min_fraction) << x;
      EXPECT_NEAR(all_mm, (run.state.position - Point<Patient>(x, 0, radius_mm - 1)).norm(), 0.02) << x;
      EXPECT_GT(result.path_segments, 0) << x;
      before_N = result.force_N.norm();
    }
    EXPECT_NEAR(run.result.force_N.z(), 0.4, 0.004);
    ASSERT_EQ(run.result.path_segments, 1);
    EXPECT_EQ(run.result.path[0].structure, 1);
    EXPECT_NEAR(-run.result.force_N.x(), 0.04, 0.002);
    EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
  }
}

TEST(Proxy, PunctureOpensTheOuterSurfaceAboveAnInnerLayer) {
  // skin 2 mm thick on bone, and bone at the outer surface where x > 2
  const GridGeometry grid = cube_grid(9, {0.5, 0.5, 0.5});
  const auto bone_mm = [](const Eigen::Vector3d& p) {
    return std::min(p.z() + 2, std::max(p.z(), 2 - p.x()));
  };
  const auto skin_mm = [](const Eigen::Vector3d& p) { return std::max(std::abs(p.z() + 1) - 1, p.x() - 2); };
  ProxyRun run;
  run.surfaces = {make_contact_surface(grid, skin_mm), make_contact_surface(grid, bone_mm),
                  make_contact_surface(grid, floor_mm)};
  run.surfaces[0].puncture_N = 1;
  run.surfaces[0].covered_by = run.surfaces[1].covered_by = 2;
  run.surfaces[2].opened_by = {0};
  run.surfaces[2].owners = std::make_shared<const Owners>(
      labelled(grid,
               [&](const Eigen::Vector3d& p) {
                 return static_cast<LabelId>(bone_mm(p) < 0 ? 2 : skin_mm(p) < 0 ? 1 : 0);
               }),
      std::vector<std::int16_t>{-1, 0, 1});
  run.at({-3, 0, 5});
  run.lead({-3, 0, 5}, {-3, 0, -0.9}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet());
  EXPECT_NEAR(run.state.position.z(), 0, 0.02);
  run.lead({-3, 0, -0.9}, {-3, 0, -2.5}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet(0b101)) << "the skin, and with it the outer surface";
  EXPECT_NEAR(run.state.position.z(), -2, 0.02) << "held by the bone";
  run.lead({-3, 0, -2.5}, {-3, 0, -1}, 0.05);
  run.lead({-3, 0, -1}, {3, 0, -1}, 0.05);
  EXPECT_NEAR(run.state.position.x(), 2, 0.02) << "held by the bone beside it";
  run.lead({3, 0, -1}, {-3, 0, -1}, 0.05);
  run.lead({-3, 0, -1}, {-3, 0, 3}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet()) << "closed behind it";
  EXPECT_EQ(run.result.force_N, Vector<Patient>());
  EXPECT_TRUE(run.holes.empty());
  // through the permanent hole the bone beneath is touched without the skin's force
  run.surfaces[0].stays_open = true;
  run.lead({-3, 0, 3}, {-3, 0, -2.5}, 0.05);
  run.lead({-3, 0, -2.5}, {-3, 0, 3}, 0.05);
  ASSERT_EQ(run.holes.all().size(), 1u);
  EXPECT_EQ(run.holes.all()[0].structure, 0);
  run.lead({-3, 0, 3}, {-3, 0, -2.1}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet(0b101));
  EXPECT_NEAR(run.state.position.z(), -2, 0.02);
  EXPECT_LT(run.result.force_N.z(), 0.3) << "of the bone alone";
  run.lead({-3, 0, -2.1}, {-3, 0, 3}, 0.05);
  // where bone is at the outer surface no force punctures
  run.lead({-3, 0, 3}, {6, 0, 3}, 0.05);
  run.lead({6, 0, 3}, {6, 0, -4}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet());
  EXPECT_NEAR(run.state.position.z(), 0, 0.02);
}

// continuity of the force while the tip slides slowly, deep below a surface
void expect_even(ProxyRun& run, const std::function<Point<Patient>(double)>& tip_at, double step) {
  run.at(tip_at(0));
  for (int n = 0; n < 50; ++n) run.at(tip_at(0));
  Vector<Patient> before = run.result.force_N;
  Point<Patient> proxy = run.state.position;
  double max_mm = 0, max_N = 0, path_mm = 0;
  const int ticks = 1500;
  for (int n = 1; n <= ticks; ++n) {
    run.at(tip_at(step * n));
    max_N = std::max(max_N, (run.result.force_N - before).norm());
    max_mm = std::max(max_mm, (run.state.position - proxy).norm());
    path_mm += (run.state.position - proxy).norm();
    before = run.result.force_N;
    proxy = run.state.position;
  }
  const double mean_mm = path_mm / ticks;
  EXPECT_GT(mean_mm, 1e-3) << "it slides";
  EXPECT_LT(max_mm, 4 * mean_mm + 1e-3) << "and does not leap";
  EXPECT_LT(max_N, 0.01 * 2) << "N, at 2 N/mm";
}

// A tip moved off the edge of a block: the nearest point jumps from its top to its side.
struct Slip {
  double largest_N = 0;  // change of force per tick beyond that explained by the displacement
  double half_s = 0;     // time until half of the force is gone
  double left_N = 0;     // half a second later
  double deepest_mm = 0;
};
Slip slip_off_an_edge(double dt_s, double stiffness_N_per_mm, double radius_mm, double speed_mm_s) {
  ProxyRun run;
  run.dt_s = dt_s;
  run.parts = {{{}, radius_mm}};
  // a block with an edge rounded by 0.5 mm
  run.surfaces = {make_contact_surface(cube_grid(8, {0.25, 0.25, 0.25}), [](const Eigen::Vector3d& p) {
    const double x = p.x() + 0.5, z = p.z() + 0.5;
    return std::hypot(std::max(x, 0.0), std::max(z, 0.0)) + std::min(std::max(x, z), 0.0) - 0.5;
  })};
  run.surfaces[0].stiffness_N_per_mm = stiffness_N_per_mm;
  const double deep_mm = 1 / stiffness_N_per_mm, step_mm = speed_mm_s * dt_s;
  run.lead({-3, 0, 2}, {-3, 0, radius_mm - deep_mm}, step_mm);
  Slip found;
  double slips_s = 0;
  Vector<Patient> before_N = run.result.force_N;
  const double far_mm = radius_mm + 0.3;
  for (double path_mm = 0, waited_s = 0; waited_s < 0.5;) {
    if (-3 + path_mm < far_mm)
      path_mm += step_mm;
    else
      waited_s += dt_s;
    run.at({-3 + path_mm, 0, radius_mm - deep_mm});
    const double moved_mm = waited_s > 0 ? 0 : step_mm;
    const double jump_N = (run.result.force_N - before_N).norm() - stiffness_N_per_mm * moved_mm;
    found.largest_N = std::max(found.largest_N, jump_N);
    before_N = run.result.force_N;
    found.left_N = before_N.norm();
    if (found.left_N < 0.95) slips_s += dt_s;
    if (found.half_s == 0 && found.left_N < 0.5) found.half_s = slips_s;
  }
  found.deepest_mm = run.deepest_mm;
  return found;
}

TEST(Proxy, SlipOffAnEdgeIsRateLimited) {
  for (const double radius_mm : {0.0, 1.0})
    for (const double stiffness : {0.5, 2.0})
      for (const double dt_s : {0.004, 0.001, 0.0001}) {
        SCOPED_TRACE(::testing::PrintToString(std::array{radius_mm, stiffness, dt_s}));
        const Slip slip = slip_off_an_edge(dt_s, stiffness, radius_mm, 20);
        EXPECT_LT(slip.largest_N, 20 * dt_s);
        EXPECT_LT(slip.left_N, 0.01);
        EXPECT_LT(slip.deepest_mm, kProxySettings.max_penetration_mm);
        // the displacement alone would take as long as the operator needs for it
        EXPECT_NEAR(slip.half_s, 0.45 / kProxySettings.max_slip_N_per_s, 0.012);
      }
}

// at a depth of 8 mm the change of shares per tick would change the force by 0.2 N
TEST(Proxy, StiffnessChangeUnderLoadIsRateLimited) {
  for (const double towards : {1.0, -1.0}) {
    ProxyRun run = two_settings();
    for (ContactSurface& surface : run.surfaces) surface.static_friction = surface.friction = 0;
    const Point<Patient> from(-5 * towards, 0, -8), to(5 * towards, 0, -8);
    run.at({from.x(), 0, 5});
    run.lead({from.x(), 0, 5}, from, 0.05);
    EXPECT_NEAR(run.result.force_N.z(), towards > 0 ? 8 : 3.2, 0.01);
    EXPECT_LT(largest_change_N(run, from, to, 0.1), 0.02);
    // a tip at rest reaches the stiffness there
    for (int n = 0; n < 400; ++n) run.at(to);
    EXPECT_NEAR(run.result.force_N.z(), towards > 0 ? 3.2 : 8, 0.01);
    EXPECT_NEAR(run.result.stiffness_N_per_mm, towards > 0 ? 0.4 : 1, 1e-3);
  }
}

// e.g. a proxy left behind without a path to the tip, which then finds one
TEST(Proxy, DistantProxyMeetsAConstraintWithoutAForceStep) {
  ProxyRun run = two_settings();
  const Point<Patient> tip(-5, 0, -3);
  run.at({-5, 0, 1});
  run.state.tip = tip;
  double before_N = 0;
  for (int n = 0; n < 300; ++n) {
    run.at(tip);
    EXPECT_LE(run.result.force_N.norm() - before_N, 0.02) << n;
    before_N = run.result.force_N.norm();
  }
  EXPECT_NEAR(before_N, 3, 0.01);
}

// the force of a tick is explained by the tip's displacement, at any depth
TEST(Proxy, FastHandIsConstrainedInTheSameTick) {
  ProxyRun run = two_settings();
  run.at({-5, 0, 1});
  run.at({-5, 0, -2});
  EXPECT_NEAR(run.result.force_N.z(), 2, 0.01);
}

TEST(Proxy, SlidesEvenlyUnderASlowTip) {
  const auto run_on = [](const testing::Distance& distance_mm) {
    ProxyRun run;
    run.surfaces = {make_contact_surface(cube_grid(22, {0.5, 0.5, 0.5}), distance_mm)};
    run.surfaces[0].stiffness_N_per_mm = 2;
    run.at({0, 0, 21});
    return run;
  };
  // 3 micrometres per tick, 3 mm deep
  ProxyRun plane = run_on([](const Eigen::Vector3d& p) { return p.z(); });
  plane.lead({0, 0, 21}, {0, 0, -3}, 0.5);
  expect_even(
      plane, [](double distance) { return Point<Patient>(distance, 0.2 * distance, -3); }, 0.003);
  ProxyRun ball = run_on([](const Eigen::Vector3d& p) { return p.norm() - 15; });
  ball.lead({0, 0, 21}, {0, 0, 12}, 0.5);
  expect_even(
      ball, [](double path) { return Point<Patient>(12 * std::sin(path / 12), 0, 12 * std::cos(path / 12)); },
      0.003);
  // a hollow whose radius of curvature is less than the depth
  ProxyRun hollow = run_on([](const Eigen::Vector3d& p) { return 5 - p.tail<2>().norm(); });
  hollow.state.coupled = false;
  hollow.at({0, 0, 0});
  hollow.lead({0, 0, 0}, {0, 0, -8}, 0.2);
  expect_even(
      hollow, [](double travel) { return Point<Patient>(travel, 0, -8); }, 0.003);
}

TEST(Proxy, FullSetOfPairsDoesNotShortenThePath) {
  ProxyRun run;
  run.surfaces.assign(40, make_contact_surface(cube_grid(10, {0.5, 0.5, 0.5}),
                                               [](const Eigen::Vector3d& p) { return p.x() + 4; }));
  run.at({0, -4.5, 0});
  run.at({0, 4.5, 0});
  EXPECT_EQ(run.state.position, Point<Patient>(0, 4.5, 0)) << "in the same tick";
}

TEST(Proxy, TipStartingInsideIsUnconstrainedUntilFree) {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(10, {0.5, 0.5, 0.5}), floor_mm)};
  for (int n = 0; n < 5; ++n) {
    run.at({0, 0, -2 + 0.3 * n});
    EXPECT_FALSE(run.state.coupled);
    EXPECT_FALSE(run.result.lagging);
    EXPECT_EQ(run.result.force_N, Vector<Patient>());
  }
  run.at({0, 0, 0.5});
  EXPECT_TRUE(run.state.coupled);
  run.lead({0, 0, 0.5}, {0, 0, -1}, 0.1);
  EXPECT_GT(run.result.force_N.z(), 0.9);
}

TEST(Proxy, InitialisesAtTheNearestFreePositionOnRequest) {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(12, {0.5, 0.5, 0.5}),
                                       [](const Eigen::Vector3d& p) { return p.norm() - 8; })};
  run.parts = {{{}, 1}};
  ASSERT_TRUE(initialise_proxy(run.surfaces, run.parts, Point<Patient>(5, 0, 0), run.state));
  EXPECT_NEAR(run.state.position.x(), 9, 0.03);
  run.at({5, 0, 0});
  EXPECT_NEAR(run.result.force_N.x(), 4, 0.1);
  // too deep for the field to have a gradient
  EXPECT_FALSE(initialise_proxy(run.surfaces, run.parts, Point<Patient>(0.3, 0, 0), run.state));
}

TEST(Proxy, PuncturesAtItsForceAndClosesBehindTheTool) {
  ProxyRun run = on_floor();
  run.surfaces[0].puncture_N = 3;  // reached at a depth of 1.5 mm
  run.lead({0, 0, 1}, {0, 0, -1.4}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet());
  EXPECT_NEAR(run.result.force_N.z(), 2.8, 0.01);
  run.lead({0, 0, -1.4}, {0, 0, -1.6}, 0.05);
  EXPECT_EQ(run.state.punctured, SurfaceSet(1));
  run.at({0, 0, -1.6});
  EXPECT_EQ(run.result.force_N, Vector<Patient>()) << "through";
  EXPECT_EQ(run.state.position, Point<Patient>(0, 0, -1.6));
  // motion inside, then out
  run.lead({0, 0, -1.6}, {1, 0, -1}, 0.1);
  EXPECT_EQ(run.state.punctured, SurfaceSet(1));
  run.lead({1, 0, -1}, {1, 0, 1}, 0.1);
  EXPECT_EQ(run.state.punctured, SurfaceSet());
  run.lead({1, 0, 1}, {1, 0, -1}, 0.1);
  EXPECT_NEAR(run.result.force_N.z(), 2, 0.01) << "closed again";
}

TEST(Proxy, TwoSpheresOnAPlaneShareTheForceAndATiltedToolTurns) {
  ProxyRun run = on_floor();
  run.parts = {{Vector<Patient>(3, 0, 0), 0.5}, {Vector<Patient>(-3, 0, 0), 0.5}};
  run.at({0, 0, 3});
  run.lead({0, 0, 3}, {0, 0, -0.5}, 0.1);
  EXPECT_EQ(run.state.contact_count, 2);
  EXPECT_NEAR(run.result.force_N.z(), 2, 5e-3);
  EXPECT_LT(run.result.torque_Nmm.norm(), 1e-3) << "balanced";
  // one sphere lower than the other: it carries the whole force, with a torque about the tip
  run.parts[0].offset_mm = Vector<Patient>(3, 0, -0.3);
  run.at({0, 0, -0.5});
  run.at({0, 0, -0.5});
  EXPECT_EQ(run.state.contact_count, 1);
  EXPECT_NEAR(run.state.position.z(), 0.8, 5e-3);
  EXPECT_NEAR(run.result.torque_Nmm.y(), -3 * run.result.force_N.z(), 1e-3) << "r x F";
}

TEST(Proxy, CapsuleContactIsCentralWhenFlatAndAtTheEndWhenTilted) {
  ProxyRun run = on_floor();
  run.parts = {{Vector<Patient>(-2, 0, 0), 1, Vector<Patient>(6, 0, 0)}};
  run.at({0, 0, 3});
  run.lead({0, 0, 3}, {0, 0, -1}, 0.05);
  EXPECT_NEAR(run.result.force_N.z(), 4, 1e-3) << "one spring, however long it is";
  EXPECT_NEAR(run.state.position.z(), 1, 1e-3);
  ASSERT_EQ(run.state.contact_count, 1);
  EXPECT_NEAR(run.state.contacts[0].axis_fraction, 0.5, 0.02);
  EXPECT_NEAR(run.result.torque_Nmm.y(), -1 * run.result.force_N.z(), 0.4) << "r x F of its middle";

  // with its far end tilted down
  const Eigen::Quaterniond tilted(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY()));
  for (int n = 0; n < 60; ++n) run.at({0, 0, -1}, tilted);
  const double low_mm = 4 * std::sin(0.3);
  EXPECT_NEAR(run.state.position.z(), 1 + low_mm, 1e-3);
  EXPECT_NEAR(run.result.force_N.z(), 2 * (2 + low_mm), 2e-3);
  EXPECT_EQ(run.state.contacts[0].axis_fraction, 1);
  EXPECT_NEAR(run.result.torque_Nmm.y(), -4 * std::cos(0.3) * run.result.force_N.z(), 1e-2);
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
}

// between two balls of one surface, one beside each of its ends: a single contact would let it slide off
TEST(Proxy, CapsuleRestsBetweenTwoBalls) {
  const auto balls = [](const Eigen::Vector3d& p) {
    return std::min((p - Eigen::Vector3d(-4, -1, 0)).norm(), (p - Eigen::Vector3d(4, 1, 0)).norm()) - 2;
  };
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(12, {0.4, 0.4, 0.4}), balls, 4)};
  run.surfaces[0].stiffness_N_per_mm = 2;
  run.parts = {{Vector<Patient>(-7, 0, 0), 1, Vector<Patient>(14, 0, 0)}};
  run.at({0, 0.3, 6});
  run.lead({0, 0.3, 6}, {0, 0, -1}, 0.02);
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm + kProxySettings.max_row_gap_mm);
  // its axis is 3 mm from both centres
  const double up_mm = std::sqrt(9.0 - 1.0);
  EXPECT_NEAR(run.state.position.y(), 0, 0.03);
  EXPECT_NEAR(run.state.position.z(), up_mm, 0.03);
  EXPECT_NEAR(run.result.force_N.z(), 2 * (up_mm + 1), 0.05);
  EXPECT_NEAR(run.result.force_N.y(), 0, 0.05);
  ASSERT_EQ(run.state.contact_count, 2);
  std::array<double, 2> parts{run.state.contacts[0].axis_fraction, run.state.contacts[1].axis_fraction};
  std::sort(parts.begin(), parts.end());
  EXPECT_NEAR(parts[0], 3.0 / 14, 0.02);
  EXPECT_NEAR(parts[1], 11.0 / 14, 0.02);
  EXPECT_NEAR(run.result.torque_Nmm.y(), 0, 0.05 * 4 * run.result.force_N.z()) << "half of it on either side";
}

TEST(Proxy, StiffnessIsWeightedByTheLoadOnEachStructure) {
  ProxyRun run;
  for (int axis = 0; axis < 2; ++axis)
    run.surfaces.push_back(make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                                [axis](const Eigen::Vector3d& p) { return p[axis]; }));
  run.surfaces[0].stiffness_N_per_mm = 1;
  run.surfaces[1].stiffness_N_per_mm = 3;
  run.at({3, 3, 0});
  run.lead({3, 3, 0}, {-1, -1, 0}, 0.1);
  EXPECT_NEAR(run.result.stiffness_N_per_mm, 2, 1e-2);
  run.lead({-1, -1, 0}, {-1, 2, 0}, 0.1);
  EXPECT_NEAR(run.result.stiffness_N_per_mm, 1, 1e-9);
}

TEST(Proxy, MoreSurfacesThanTheTickBudgetStillConstrain) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  ProxyRun run;
  // a heap of overlapping balls, many of which the tool touches
  for (int s = 0; s < 40; ++s) {
    const Eigen::Vector3d centre = random_direction(random).eigen() * 1.5;
    run.surfaces.push_back(make_contact_surface(
        cube_grid(7, {0.5, 0.5, 0.5}), [=](const Eigen::Vector3d& p) { return (p - centre).norm() - 2.0; },
        2));
  }
  run.parts = {{{}, 1}};
  for (int n = 0; n < 30; ++n) {
    const Vector<Patient> side = random_direction(random);
    run.state = {};
    run.at(Point<Patient>() + side * 8);
    run.lead(run.state.position, Point<Patient>() - side * 2, 0.4);
    for (int settle = 0; settle < 30; ++settle) run.at(Point<Patient>() - side * 2);
    ASSERT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
    EXPECT_GT(run.result.force_N.norm(), 1);
  }
}

}  // namespace
}  // namespace palpate
