#include "palpate/contact/proxy.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "contact/capsule_row.h"
#include "contact/test_proxy_surfaces.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::Distance;
using testing::make_contact_surface;
using testing::ProxyRun;
using testing::random_direction;

constexpr unsigned kProxySeed = 51;
const Eigen::Vector3d kKnee_mm(0.277, 0.277, 1.0);

// half-space below z = 0
double floor_mm(const Eigen::Vector3d& p) {
  return p.z();
}

ProxyRun on_floor(double friction_static = 0, double friction_dynamic = 0, double stiffness = 2) {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(10, {0.5, 0.5, 0.5}), floor_mm)};
  run.surfaces[0].stiffness_N_per_mm = stiffness;
  run.surfaces[0].static_friction = friction_static;
  run.surfaces[0].friction = friction_dynamic;
  run.at({0, 0, 3});
  return run;
}

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
    run.spheres = {{{}, radius_mm}};
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
    run.spheres = {{{}, radius_mm}};
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
  run.spheres = {{{}, 0.3}, {{5, 0, 0}, 0.5}};
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
    run.spheres = {{{}, radius_mm}};
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
  run.spheres.clear();
  for (const double lateral_mm : {0.0, 0.001, 0.002, 0.003})
    run.spheres.push_back({Vector<Patient>(lateral_mm, lateral_mm, lateral_mm), 1});
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
  run.spheres = {{{}, 1.5}};
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
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
}

TEST(Proxy, SlightPenetrationByRotationIsCorrectedWithoutANewConstraint) {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}), floor_mm),
                  make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                       [](const Eigen::Vector3d& p) { return 2 - p.z(); })};
  run.spheres = {{Vector<Patient>(2, 0, 0), 0.5}, {Vector<Patient>(-2, 0, 0), 0.5}};
  run.at({0, 0, 1});
  for (int n = 1; n <= 40; ++n) {
    // one sphere moves down and the other up by 10 micrometres per tick
    run.spheres[0].offset_mm = Vector<Patient>(2, 0, -0.01 * n);
    run.spheres[1].offset_mm = Vector<Patient>(-2, 0, 0.01 * n);
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

// a membrane 1 mm thick with free space below
ProxyRun on_membrane() {
  ProxyRun run;
  run.surfaces = {make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                                       [](const Eigen::Vector3d& p) { return std::abs(p.z()) - 0.5; })};
  run.surfaces[0].stiffness_N_per_mm = 2;
  run.surfaces[0].puncture_N = 1;
  run.surfaces[0].stays_open = true;
  run.spheres = {{{}, 0.5}};
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
  run.spheres = {{{}, 0.8}};
  EXPECT_NEAR(force_through_N(run, {0, 0, 4}, {0, 0, -4}), 1, 0.1) << "wider";
  run.spheres = {{{}, 0}};
  EXPECT_LT(force_through_N(run, {0.5, 0, -4}, {0.5, 0, 4}), 0.1) << "a point, within";
}

TEST(Proxy, TwoPartToolPassesThroughItsTwoHoles) {
  ProxyRun run = on_membrane();
  run.spheres = {{Vector<Patient>(-1.5, 0, 0), 0.5}, {Vector<Patient>(1.5, 0, 0), 0.5}};
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

// labels by position, as voxels
Bricks<LabelId> labelled(const GridGeometry& grid,
                         const std::function<LabelId(const Eigen::Vector3d&)>& label_at) {
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        labels.at(i, j, k) = label_at((grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen());
  return *label_bricks(labels);
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
    run.spheres = {{{}, radius_mm}};
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

// Soft tissue on hard tissue, e.g. fat on bone; the outer surface is z = 0.
ProxyRun layered(double soft_N_per_mm, double hard_N_per_mm, const Distance& hard_mm) {
  const GridGeometry grid = cube_grid(20, {0.5, 0.5, 0.5});
  ProxyRun run;
  run.surfaces = {make_contact_surface(grid, floor_mm), make_contact_surface(grid, hard_mm)};
  run.surfaces[0].stiffness_N_per_mm = run.surfaces[0].upper_N_per_mm = soft_N_per_mm;
  run.surfaces[1].stiffness_N_per_mm = hard_N_per_mm;
  run.surfaces[1].lower_N_per_mm = soft_N_per_mm;
  run.surfaces[1].layer = 1;
  return run;
}

TEST(ProxyLayers, IntegrateStiffnessAlongTheEntryPath) {
  struct Case {
    double soft_N_per_mm, hard_N_per_mm, thick_mm;
  };
  // fat, meniscus and cartilage on bone
  for (const Case& c : {Case{0.036, 1.5, 10}, Case{0.25, 1.5, 4}, Case{0.9, 1.5, 2}})
    for (const double radius_mm : {0.0, 1.5}) {
      ProxyRun run = layered(c.soft_N_per_mm, c.hard_N_per_mm,
                             [&](const Eigen::Vector3d& p) { return p.z() + c.thick_mm; });
      run.spheres = {{{}, radius_mm}};
      run.at({0, 0, 5});
      for (double depth_mm = -2; depth_mm < c.thick_mm + 5; depth_mm += 0.05) {
        const ProxyResult& result = run.at({0.1, 0.2, radius_mm - depth_mm});
        const double in_hard_mm = std::max(0.0, depth_mm - c.thick_mm);
        const double expected_N =
            c.soft_N_per_mm * std::max(0.0, depth_mm) + (c.hard_N_per_mm - c.soft_N_per_mm) * in_hard_mm;
        ASSERT_NEAR(result.force_N.z(), expected_N, 1e-3 + 1e-3 * expected_N) << depth_mm;
        ASSERT_NEAR(result.stiffness_N_per_mm,
                    in_hard_mm > 0.01 ? c.hard_N_per_mm
                    : depth_mm > 0.01 ? c.soft_N_per_mm
                                      : 0,
                    depth_mm > -0.01 && depth_mm < 0.01 ? 2 : 1e-9)
            << depth_mm;
      }
      EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
      run.lead({0.1, 0.2, radius_mm - c.thick_mm - 5}, {0.1, 0.2, radius_mm + 1}, 0.05);
      EXPECT_EQ(run.result.force_N, Vector<Patient>());
    }
}

TEST(ProxyLayers, ReportPathLengthAndForcePerStructure) {
  ProxyRun run = layered(0.036, 1.5, [](const Eigen::Vector3d& p) { return p.z() + 10; });
  run.at({0, 0, 5});
  EXPECT_EQ(run.result.path_segments, 0);
  run.lead({0, 0, 5}, {0.1, 0.2, -4}, 0.05);
  ASSERT_EQ(run.result.path_segments, 1);
  EXPECT_EQ(run.result.path[0].structure, 0);
  EXPECT_NEAR(run.result.path[0].depth_mm, 4, 0.02);
  EXPECT_NEAR(run.result.path[0].fraction, 1, 1e-12);
  run.lead({0.1, 0.2, -4}, {0.1, 0.2, -15}, 0.05);
  ASSERT_EQ(run.result.path_segments, 2);
  // 10 mm of fat, 5 mm of bone: 0.36 and 7.5 N
  EXPECT_EQ(run.result.path[0].structure, 0);
  EXPECT_NEAR(run.result.path[0].depth_mm, 10, 0.02);
  EXPECT_NEAR(run.result.path[0].fraction, 0.36 / 7.86, 1e-3);
  EXPECT_EQ(run.result.path[1].structure, 1);
  EXPECT_NEAR(run.result.path[1].depth_mm, 5, 0.02);
  EXPECT_NEAR(run.result.path[1].fraction, 7.5 / 7.86, 1e-3);
}

// A fast operator withdraws the tool within one tick, more so on a device with a low tick rate.
TEST(ProxyLayers, ToolLiftedOffWithinATickHasNoForce) {
  const auto flat_mm = [](const Eigen::Vector3d& p) { return p.z() + 2; };
  const auto slope_mm = [](const Eigen::Vector3d& p) { return 0.8 * (p.z() + 2) - 0.6 * p.x(); };
  const auto groove_mm = [](const Eigen::Vector3d& p) { return 0.6 * (p.z() + 2) - 0.8 * std::abs(p.x()); };
  for (const Distance& hard_mm : std::initializer_list<Distance>{flat_mm, slope_mm, groove_mm})
    for (const double above_mm : {0.1, 0.6, 3.0}) {
      SCOPED_TRACE(above_mm);
      ProxyRun run = layered(0.1, 1.5, hard_mm);
      run.spheres = {{{}, 0.5}, {{0, 0, 4}, 1}};
      run.at({0, 0, 5});
      run.lead({0, 0, 5}, {0, 0, -4}, 0.02);
      EXPECT_GT(run.result.of_layer[0].force_N.norm(), 0.1);
      EXPECT_GT(run.result.of_layer[1].force_N.norm(), 1);
      run.at({0, 0, 0.5 + above_mm});
      EXPECT_EQ(run.result.force_N, Vector<Patient>());
      EXPECT_EQ(run.result.stored_mJ, 0);
    }
}

TEST(ProxyLayers, OnASlopeUnderFatForceIsTheGradientOfStoredEnergy) {
  const double tilt = 0.5235987755982988;  // 30 degrees
  const auto slope_mm = [&](const Eigen::Vector3d& p) {
    return std::cos(tilt) * (p.z() + 6) - std::sin(tilt) * p.x();
  };
  ProxyRun run = layered(0.1, 1.5, slope_mm);
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> lateral(-3, 3), deep(1, 9);
  const auto settled = [&](const Point<Patient>& tip) {
    run.state = {};
    run.at({tip.x(), tip.y(), 3});
    run.lead({tip.x(), tip.y(), 3}, tip, 0.05);
    return run.result;
  };
  int hard = 0;
  for (int n = 0; n < 40; ++n) {
    const Point<Patient> tip(lateral(random), lateral(random), -deep(random));
    const ProxyResult there = settled(tip);
    hard += there.stiffness_N_per_mm > 1;
    constexpr double kApart = 0.02;
    for (int a = 0; a < 3; ++a) {
      Eigen::Vector3d displacement = Eigen::Vector3d::Zero();
      displacement[a] = kApart;
      const double more = settled(tip + Vector<Patient>(displacement)).stored_mJ;
      const double less = settled(tip - Vector<Patient>(displacement)).stored_mJ;
      EXPECT_NEAR(there.force_N[a], (less - more) / (2 * kApart), 0.01 + 0.02 * there.force_N.norm()) << n;
    }
  }
  EXPECT_GT(hard, 5);

  // closed loops in contact generate no energy
  run.state = {};
  run.at({0, 0, 3});
  run.lead({0, 0, 3}, {2, 0, -6}, 0.05);
  double worst_mJ = 0;
  for (int round = 0; round < 5; ++round) {
    double work_mJ = 0;
    Point<Patient> before(2, 0, -6);
    for (int n = 1; n <= 400; ++n) {
      const double angle = n * 0.015707963267948967;
      const Point<Patient> tip(2 * std::cos(angle), 2 * std::sin(angle), -6 - 1.5 * std::sin(2 * angle));
      const Vector<Patient> before_N = run.result.force_N;
      run.at(tip);
      work_mJ += 0.5 * (before_N + run.result.force_N).dot(tip - before);
      before = tip;
    }
    worst_mJ = std::max(worst_mJ, std::abs(work_mJ));
  }
  EXPECT_LT(worst_mJ, 0.01);
}

TEST(ProxyLayers, AreClampedTogetherToTheDeviceStiffness) {
  ProxyRun run = layered(0.5, 1.5, [](const Eigen::Vector3d& p) { return p.z() + 2; });
  const ProxyOptions options{true, 1.0};
  const std::array<ToolSphere, 1> point{};
  for (const double z : {5.0, -1.0, -2.0, -3.0}) {
    ProxyState state;
    advance_proxy(run.surfaces, point, Point<Patient>(0, 0, 5), state, options);
    ProxyResult result;
    for (int n = 0; n < 20; ++n)
      result = advance_proxy(run.surfaces, point, Point<Patient>(0, 0, z), state, options);
    EXPECT_NEAR(result.force_N.z(), 0.5 * std::max(0.0, -z) + 0.5 * std::max(0.0, -z - 2), 1e-3) << z;
  }
}

TEST(ProxyLayers, UseCurrentStiffnessOnSurfacesPreparedForOthers) {
  ProxyRun run = layered(0.5, 1.5, [](const Eigen::Vector3d& p) { return p.z() + 2; });
  const auto pressed_N = [&](double z) {
    run.state = {};
    run.at({0, 0, 5});
    run.lead({0, 0, 5}, {0, 0, z}, 0.05);
    return run.result.force_N.z();
  };
  // the outer layer has its full stiffness
  run.surfaces[0].stiffness_N_per_mm = 0.8;
  EXPECT_NEAR(pressed_N(-1), 0.8, 1e-3);
  run.surfaces[0].stiffness_N_per_mm = 0.2;
  EXPECT_NEAR(pressed_N(-1), 0.2, 1e-3);
  // the inner layer has the difference: the stiffness is integrated along the path
  run.surfaces[1].stiffness_N_per_mm = 2;
  EXPECT_NEAR(pressed_N(-3), 0.2 * 2 + 2 * 1, 2e-3);
  run.surfaces[1].stiffness_N_per_mm = 0.3;
  EXPECT_NEAR(pressed_N(-3), 0.2 * 2 + 0.3 * 1, 2e-3);
  run.surfaces[1].stiffness_N_per_mm = 0.1;
  EXPECT_NEAR(pressed_N(-3), 0.2 * 3, 2e-3) << "softer than what lies around it is no layer";
}

TEST(ProxyLayers, PunctureOpensEveryLayer) {
  // skin of 2 mm, K 0.3, on fat, K 0.05, on bone at 6 mm; skin and bone have layers of their own
  const GridGeometry grid = cube_grid(12, {0.5, 0.5, 0.5});
  const auto skin_mm = [](const Eigen::Vector3d& p) { return std::abs(p.z() + 1) - 1; };
  const auto inner_mm = [](const Eigen::Vector3d& p) { return p.z() + 2; };
  const auto bone_mm = [](const Eigen::Vector3d& p) { return p.z() + 6; };
  const auto labels = [&](bool with_skin) {
    return std::make_shared<const Owners>(
        labelled(grid,
                 [&](const Eigen::Vector3d& p) {
                   const double z = p.z();
                   return static_cast<LabelId>(z < -6 ? 3 : z < -2 ? 2 : z < 0 && with_skin ? 1 : 0);
                 }),
        std::vector<std::int16_t>{-1, 0, 1, 2});
  };
  ProxyRun run;
  run.surfaces.resize(3);
  run.surfaces[0] = make_contact_surface(grid, skin_mm);  // layer 1, skin's own
  run.surfaces[0].stiffness_N_per_mm = 0.3;
  run.surfaces[0].lower_N_per_mm = 0.05;
  run.surfaces[0].upper_N_per_mm = 0.3;
  run.surfaces[0].layer = 1;
  run.surfaces[0].puncture_N = 0.4;
  run.surfaces[1].stiffness_N_per_mm = 0.05;  // fat
  run.surfaces[2] = make_contact_surface(grid, bone_mm);
  run.surfaces[2].stiffness_N_per_mm = 1.5;
  run.surfaces[2].lower_N_per_mm = 0.05;
  run.surfaces[2].layer = 1;
  const auto in_first_layer = [&](ContactSurface surface) {
    surface.upper_N_per_mm = 0.05;
    surface.static_friction = surface.friction = 0;
    return surface;
  };
  ContactSurface common = in_first_layer(make_contact_surface(grid, floor_mm));
  common.owners = labels(true);
  common.opened_by = {0};
  run.surfaces.push_back(common);
  ContactSurface skin = in_first_layer(run.surfaces[0]);
  skin.lower_N_per_mm = 0;
  skin.layer = 0;
  skin.structure = 0;
  skin.covered_by = 3;
  run.surfaces.push_back(skin);
  ContactSurface rest = in_first_layer(make_contact_surface(grid, inner_mm));
  rest.owners = labels(false);
  rest.covered_by = 3;
  run.surfaces.push_back(rest);

  run.at({0, 0, 5});
  run.lead({0, 0, 5}, {0, 0, -1}, 0.02);
  EXPECT_NEAR(run.result.force_N.z(), 0.3, 0.01) << "skin gives all of its own";
  run.lead({0, 0, -1}, {0, 0, -1.5}, 0.02);
  EXPECT_TRUE(run.state.punctured.any());
  run.lead({0, 0, -1.5}, {0, 0, -4}, 0.02);
  EXPECT_NEAR(run.result.force_N.z(), 0.05 * 2, 0.01) << "fat, from where it begins";
  run.lead({0, 0, -4}, {0, 0, -6.4}, 0.02);
  EXPECT_NEAR(run.result.force_N.z(), 0.05 * 4.4 + 1.45 * 0.4, 0.02) << "and bone";
  run.lead({0, 0, -6.4}, {0, 0, 4}, 0.02);
  EXPECT_EQ(run.result.force_N, Vector<Patient>());
  for (int n = 0; n < 2; ++n) EXPECT_EQ(run.state.layer(n).punctured, SurfaceSet()) << n;
  run.lead({0, 0, 4}, {0, 0, -1}, 0.02);
  EXPECT_NEAR(run.result.force_N.z(), 0.3, 0.01) << "closed again";
}

TEST(ProxyLayers, HoleOfAnInnerStructureReachesAsDeepAsItsProxy) {
  // a membrane of 1 mm in soft tissue that is not punctured
  ProxyRun run = layered(0.05, 1, [](const Eigen::Vector3d& p) { return std::abs(p.z() + 4) - 0.5; });
  run.surfaces[1].puncture_N = 0.5;
  run.surfaces[1].stays_open = true;
  run.spheres = {{{}, 0.5}};
  run.at({0, 0, 4});
  run.lead({0, 0, 4}, {0, 0, -7}, 0.02);
  ASSERT_EQ(run.holes.all().size(), 1u);
  EXPECT_EQ(run.state.layer(0).punctured, SurfaceSet());
  EXPECT_NEAR(run.holes.all()[0].length_mm, 2.2, 0.1) << "membrane, tool, and distance at which it closes";
  // back through the same hole, without its puncture force
  double max_N = 0;
  for (double z_mm = -7; z_mm < -2; z_mm += 0.02) {
    run.at({0, 0, z_mm});
    max_N = std::max(max_N, -run.result.force_N.z());
  }
  EXPECT_LT(max_N, 0.1);
  EXPECT_EQ(run.holes.all().size(), 1u);
}

TEST(ProxyLayers, TipStartingInsideIsUnconstrained) {
  ProxyRun run = layered(0.1, 1.5, [](const Eigen::Vector3d& p) { return p.z() + 4; });
  run.at({0, 0, -2});
  EXPECT_FALSE(run.state.coupled);
  run.lead({0, 0, -2}, {0, 0, -6}, 0.05);
  EXPECT_EQ(run.result.force_N, Vector<Patient>());
  run.lead({0, 0, -6}, {0, 0, 2}, 0.05);
  run.lead({0, 0, 2}, {0, 0, -6}, 0.05);
  EXPECT_NEAR(run.result.force_N.z(), 0.1 * 6 + 1.4 * 2, 0.01);
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
  run.spheres = {{{}, radius_mm}};
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

// maximum change of force per tick beyond that explained by the displacement, on a path in steps
double largest_change_N(ProxyRun& run, const Point<Patient>& from, const Point<Patient>& to, double step_mm) {
  double largest_N = 0;
  const int steps = static_cast<int>(std::lround((to - from).norm() / step_mm));
  for (int n = 1; n <= steps; ++n) {
    const ProxyResult before = run.result;
    run.at(from + (to - from) * (static_cast<double>(n) / steps));
    const double non_slip_change_N =
        std::max(before.stiffness_N_per_mm, run.result.stiffness_N_per_mm) * step_mm;
    largest_N = std::max(largest_N, (run.result.force_N - before.force_N).norm() - non_slip_change_N);
  }
  return largest_N;
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

// bone that ends under fat: slip not used by the fat is available to the bone
TEST(ProxyLayers, UnusedSlipBudgetIsAvailableToInnerLayers) {
  ProxyRun run = layered(0.5, 1.5, [](const Eigen::Vector3d& p) {
    const double x = p.x() + 0.5, z = p.z() + 2.5;
    return std::hypot(std::max(x, 0.0), std::max(z, 0.0)) + std::min(std::max(x, z), 0.0) - 0.5;
  });
  // 3 mm deep in bone, from 3 mm inside its side over the edge
  run.at({-3, 0, 2});
  run.lead({-3, 0, 2}, {-3, 0, -5}, 0.05);
  EXPECT_NEAR(run.result.of_layer[1].force_N.norm(), 3, 0.01);
  EXPECT_LT(largest_change_N(run, {-3, 0, -5}, {0.6, 0, -5}, 0.3), 0.02);
  const double left_N = run.result.of_layer[1].force_N.norm();
  EXPECT_GT(left_N, 1);
  int ticks = 0;
  while (run.result.of_layer[1].force_N.norm() > 0.01 && ticks < 500) {
    const Vector<Patient> before_N = run.result.force_N;
    run.at({0.6, 0, -5});
    EXPECT_LT((run.result.force_N - before_N).norm(), 0.02);
    ++ticks;
  }
  EXPECT_NEAR(ticks * 1e-3, left_N / kProxySettings.max_slip_N_per_s,
              0.1 * left_N / kProxySettings.max_slip_N_per_s);
  EXPECT_NEAR(run.result.force_N.z(), 0.5 * 5, 0.01);
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

TEST(Proxy, FrictionConeHasTheCoefficient) {
  const double mu_static = 0.4, mu_dynamic = 0.25, depth_mm = 1.5;
  ProxyRun run = on_floor(mu_static, mu_dynamic);
  run.lead({0, 0, 1}, {0, 0, -depth_mm}, 0.05);
  EXPECT_TRUE(run.state.sticking);
  // pulled sideways: sticks up to the static cone, then slides on the kinetic cone
  double max_ratio = 0;
  double x = 0;
  while (run.state.sticking && x < 2) {
    run.at({x += 0.001, 0, -depth_mm});
    if (run.state.sticking)
      max_ratio = std::max(max_ratio, std::abs(run.result.force_N.x()) / run.result.force_N.z());
  }
  EXPECT_NEAR(max_ratio, mu_static, 0.02 * mu_static);
  for (int n = 0; n < 1000; ++n) {
    run.at({x += 0.003, 0, -depth_mm});
    EXPECT_NEAR(-run.result.force_N.x() / run.result.force_N.z(), mu_dynamic, 0.02 * mu_dynamic);
    EXPECT_FALSE(run.state.sticking);
  }
  // after stopping it sticks again, and needs the static cone to come loose
  run.at({x, 0, -depth_mm});
  run.at({x, 0, -depth_mm});
  EXPECT_TRUE(run.state.sticking);
}

// on a plane of any orientation to the voxels, in any tangential direction
TEST(Proxy, FrictionConeHasTheCoefficientOnEveryPlane) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int n = 0; n < 40; ++n) {
    const Vector<Patient> up = random_direction(random);
    const Vector<Patient> along = up.cross(random_direction(random)).normalized();
    // the normal of a sampled plane has an error of up to 0.6 mrad, 2 % of a coefficient below 0.03
    const double mu_static = 0.05 + unit(random);
    const double mu_dynamic = 0.05 + (mu_static - 0.05) * unit(random);
    const double depth_mm = 0.5 + 2 * unit(random);
    SCOPED_TRACE("plane " + std::to_string(n));
    ProxyRun run;
    run.surfaces = {make_contact_surface(cube_grid(9, kKnee_mm),
                                         [&](const Eigen::Vector3d& p) { return up.eigen().dot(p); })};
    run.surfaces[0].static_friction = mu_static;
    run.surfaces[0].friction = mu_dynamic;
    run.spheres = {{{}, n % 2 == 0 ? 0 : 1.5 * unit(random)}};
    const double above_mm = run.spheres[0].radius_mm;
    const auto tip = [&](double path_mm, double height_mm) {
      return Point<Patient>() + along * path_mm + up * (above_mm + height_mm);
    };
    const auto ratio = [&] {
      const double normal_N = run.result.force_N.dot(up);
      return (run.result.force_N - up * normal_N).norm() / normal_N;
    };
    run.at(tip(0, 1));
    run.lead(tip(0, 1), tip(0, -depth_mm), 0.05);
    ASSERT_TRUE(run.state.sticking);
    double path_mm = 0, max_ratio = 0;
    const double stride_mm = mu_static * depth_mm / 1000;
    while (run.state.sticking && path_mm < 5) {
      max_ratio = std::max(max_ratio, ratio());
      run.at(tip(path_mm += stride_mm, -depth_mm));
    }
    EXPECT_NEAR(max_ratio, mu_static, 0.02 * mu_static);
    for (int slid = 0; slid < 300; ++slid) {
      run.at(tip(path_mm += 0.003, -depth_mm));
      ASSERT_NEAR(ratio(), mu_dynamic, 0.02 * mu_dynamic);
    }
  }
}

TEST(Proxy, DoesNotDriftWhileItSticks) {
  for (const bool curved : {false, true}) {
    ProxyRun run;
    run.surfaces = {make_contact_surface(cube_grid(12, kKnee_mm), [&](const Eigen::Vector3d& p) {
      return curved ? (p + Eigen::Vector3d(0, 0, 10)).norm() - 10 : p.z() + 0.2 * p.x();
    })};
    run.surfaces[0].static_friction = 0.6;
    run.surfaces[0].friction = 0.5;
    run.at({1, 0.5, 3});
    run.lead({1, 0.5, 3}, {1, 0.5, -2}, 0.05);
    for (int n = 0; n < 20; ++n) run.at({1, 0.5, -2});
    EXPECT_TRUE(run.state.sticking);
    const Point<Patient> before = run.state.position;
    // 10 s at 1 kHz, with a tremor inside the friction cone
    for (int n = 0; n < 10'000; ++n)
      run.at({1 + 0.05 * std::sin(0.06 * n), 0.5 + 0.05 * std::cos(0.05 * n), -2});
    run.at({1, 0.5, -2});
    EXPECT_LT((run.state.position - before).norm(), 1e-3) << "mm";
  }
}

TEST(Proxy, NewConstraintOnThePathKeepsSticking) {
  // Sticking on a floor at a distance from a wall just above the constraint distance, pulled into the notch
  // and along it. On the floor alone it would slide; in the notch static friction holds it.
  for (const double before_wall_mm : {0.055, 0.06, 0.065}) {
    SCOPED_TRACE(before_wall_mm);
    ProxyRun run = on_floor(0.8, 0.2);
    run.surfaces.push_back(
        make_contact_surface(cube_grid(10, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return p.x(); }));
    run.surfaces[1].static_friction = 0.8;
    run.surfaces[1].friction = 0.2;
    run.surfaces[1].stiffness_N_per_mm = 2;
    run.lead({before_wall_mm, 0, 3}, {before_wall_mm, 0, -1}, 0.1);
    ASSERT_TRUE(run.state.sticking);
    ASSERT_EQ(run.state.contact_count, 1);
    run.at({-1.5, 0.6, -1});
    EXPECT_EQ(run.state.contact_count, 2);
    EXPECT_TRUE(run.state.sticking);
    EXPECT_NEAR(run.state.position.y(), 0, 1e-3);
  }
}

TEST(Proxy, DiscardedAttemptDoesNotExtendTheDisplacementLimit) {
  // Sticking on a floor in front of a wall, pulled towards it until static friction would release the proxy.
  // That attempt penetrates the wall and is discarded, and in the notch the proxy sticks: its distance to the
  // goal is slip.
  constexpr double kBeforeWall_mm = 0.06, kTick_mm = 0.01, kFloor_N_per_mm = 2;
  ProxyRun run = on_floor(1, 0.1, kFloor_N_per_mm);
  run.surfaces.push_back(make_contact_surface(
      cube_grid(10, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return kBeforeWall_mm - p.x(); }));
  run.surfaces[1].stiffness_N_per_mm = kFloor_N_per_mm;
  run.surfaces[1].static_friction = 1;
  run.surfaces[1].friction = 0.1;
  run.lead({0, 0, 3}, {0, 0, -1}, 0.1);
  ASSERT_TRUE(run.state.sticking);
  const double max_N = kFloor_N_per_mm * kTick_mm + kProxySettings.max_slip_N_per_s * run.dt_s + 1e-6;
  for (double x_mm = 0; x_mm < 1.5; x_mm += kTick_mm) {
    const Vector<Patient> before_N = run.result.force_N;
    run.at({x_mm, 0, -1});
    ASSERT_LE((run.result.force_N - before_N).norm(), max_N) << x_mm;
  }
  EXPECT_NEAR(run.state.position.x(), kBeforeWall_mm, 0.01) << "it has come to the wall";
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
  run.spheres = {{{}, 1}};
  ASSERT_TRUE(initialise_proxy(run.surfaces, run.spheres, Point<Patient>(5, 0, 0), run.state));
  EXPECT_NEAR(run.state.position.x(), 9, 0.03);
  run.at({5, 0, 0});
  EXPECT_NEAR(run.result.force_N.x(), 4, 0.1);
  // too deep for the field to have a gradient
  EXPECT_FALSE(initialise_proxy(run.surfaces, run.spheres, Point<Patient>(0.3, 0, 0), run.state));
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
  run.spheres = {{Vector<Patient>(3, 0, 0), 0.5}, {Vector<Patient>(-3, 0, 0), 0.5}};
  run.at({0, 0, 3});
  run.lead({0, 0, 3}, {0, 0, -0.5}, 0.1);
  EXPECT_EQ(run.state.contact_count, 2);
  EXPECT_NEAR(run.result.force_N.z(), 2, 5e-3);
  EXPECT_LT(run.result.torque_Nmm.norm(), 1e-3) << "balanced";
  // one sphere lower than the other: it carries the whole force, with a torque about the tip
  run.spheres[0].offset_mm = Vector<Patient>(3, 0, -0.3);
  run.at({0, 0, -0.5});
  run.at({0, 0, -0.5});
  EXPECT_EQ(run.state.contact_count, 1);
  EXPECT_NEAR(run.state.position.z(), 0.8, 5e-3);
  EXPECT_NEAR(run.result.torque_Nmm.y(), -3 * run.result.force_N.z(), 1e-3) << "r x F";
}

TEST(Proxy, CapsuleContactIsCentralWhenFlatAndAtTheEndWhenTilted) {
  ProxyRun run = on_floor();
  run.spheres = {{Vector<Patient>(-2, 0, 0), 1, Vector<Patient>(6, 0, 0)}};
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
  run.spheres = {{Vector<Patient>(-7, 0, 0), 1, Vector<Patient>(14, 0, 0)}};
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
  run.spheres = {{{}, 1}};
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

// the cache of a resting proxy may only affect the time
TEST(Proxy, CachedContactAtRestEqualsAFreshSearch) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> unit(0, 1), about(-1, 1);
  long rests = 0, ticks = 0, ruptures = 0;
  for (int scene = 0; scene < 30; ++scene) {
    ProxyRun run;
    for (int s = 0; s < 4; ++s) {
      const Eigen::Vector3d centre(2 * about(random), 2 * about(random), 2 * about(random));
      const double radius_mm = 1.5 + 2 * unit(random);
      run.surfaces.push_back(make_contact_surface(
          cube_grid(9, {0.5, 0.5, 0.5}),
          [=](const Eigen::Vector3d& p) { return (p - centre).norm() - radius_mm; }, 2));
      ContactSurface& surface = run.surfaces.back();
      surface.friction = 0.4 * unit(random);
      surface.static_friction = surface.friction + 0.3 * unit(random);
      surface.layer = s / 2;
      if (scene % 3 == 0 && s == 0) surface.puncture_N = 1.5;
    }
    // in some scenes friction and stiffness vary along the surface by ownership shares
    if (scene % 4 == 2) {
      Volume<LabelId> halves(cube_grid(9, {0.5, 0.5, 0.5}));
      const auto X_PatientVoxel = halves.geometry().X_PatientVoxel();
      const auto& dims = halves.geometry().dims;
      for (int k = 0; k < dims[2]; ++k)
        for (int j = 0; j < dims[1]; ++j)
          for (int i = 0; i < dims[0]; ++i) {
            const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
            if (p.norm() < 4) halves.at(i, j, k) = p.x() < 0.3 * p.y() ? 1 : 2;
          }
      run.surfaces[0].owners =
          std::make_shared<const Owners>(*label_bricks(halves), std::vector<std::int16_t>{-1, 0, 1});
      run.surfaces[1].stiffness_N_per_mm = 0.6;
    }
    // one sphere, three that rotate, or two with a shaft
    const double radius_mm = unit(random);
    run.spheres = {{{}, radius_mm}};
    if (scene % 3 == 1) run.spheres.insert(run.spheres.end(), {{{2, 0, 0}, 0.5}, {{0, 2, 1}, 0.7}});
    if (scene % 5 == 4) run.spheres.push_back({{0, 0, 0.5}, 0.3, {0, 0, 4}});
    ProxyState without_cache;
    Holes holes;
    Point<Patient> tip(0, 0, 12);
    Vector<Patient> displacement;
    Eigen::Quaterniond attitude = Eigen::Quaterniond::Identity();
    for (int n = 0; n < 1500; ++n) {
      // alternately held still with a tremor, and moving
      const bool is_jittering = n % 300 > 120;
      displacement = displacement * 0.97 + random_direction(random) * 0.05 + (Point<Patient>() - tip) * 0.003;
      tip += is_jittering ? random_direction(random) * 0.002 : displacement;
      if (!is_jittering && scene % 2 == 1)
        attitude = Eigen::AngleAxisd(0.01, random_direction(random).eigen()) * attitude;
      const ToolPose hand(tip, attitude);
      const auto spheres = run.turned(hand.attitude);
      const bool knew = !run.state.cache(0)
                             .at_rest.find(run.state.position, run.state.punctured, spheres.spheres())
                             .empty();
      const ProxyResult is =
          advance_proxy(run.surfaces, spheres.spheres(), hand, run.state, {.holes = &run.holes});
      for (int layer = 0; layer < kMaxLayers; ++layer) without_cache.cache(layer).at_rest.invalidate();
      const ProxyResult expected =
          advance_proxy(run.surfaces, spheres.spheres(), hand, without_cache, {.holes = &holes});
      ASSERT_EQ(is.force_N, expected.force_N) << "scene " << scene << ", tick " << n;
      ASSERT_EQ(is.torque_Nmm, expected.torque_Nmm);
      ASSERT_EQ(is.normal, expected.normal);
      ASSERT_EQ(is.friction, expected.friction);
      ASSERT_EQ(is.stiffness_N_per_mm, expected.stiffness_N_per_mm);
      ASSERT_EQ(is.stored_mJ, expected.stored_mJ);
      ASSERT_EQ(is.wedged, expected.wedged);
      ASSERT_EQ(is.lagging, expected.lagging);
      ASSERT_EQ(is.ruptured, expected.ruptured);
      for (int m = 0; m < 2; ++m) {
        const ProxyLayer &layer = run.state.layer(m), &other = without_cache.layer(m);
        ASSERT_EQ(layer.position, other.position) << "scene " << scene << ", tick " << n << ", layer " << m;
        ASSERT_EQ(layer.attitude.coeffs(), other.attitude.coeffs());
        ASSERT_EQ(layer.last_displacement, other.last_displacement);
        ASSERT_EQ(layer.coupled, other.coupled);
        ASSERT_EQ(layer.sticking, other.sticking);
        ASSERT_EQ(layer.punctured, other.punctured);
        ASSERT_EQ(layer.stretch_fraction, other.stretch_fraction);
        ASSERT_EQ(layer.spring_N_per_mm, other.spring_N_per_mm);
        ASSERT_EQ(layer.catch_up_mm, other.catch_up_mm);
        ASSERT_EQ(layer.stranded_s, other.stranded_s);
        ASSERT_EQ(layer.contact_count, other.contact_count);
        for (int c = 0; c < layer.contact_count; ++c) {
          const ProxyContact &contact = layer.contacts[static_cast<std::size_t>(c)],
                             &again = other.contacts[static_cast<std::size_t>(c)];
          ASSERT_EQ(contact.surface, again.surface);
          ASSERT_EQ(contact.sphere, again.sphere);
          ASSERT_EQ(contact.axis_fraction, again.axis_fraction);
          ASSERT_EQ(contact.normal, again.normal);
          ASSERT_EQ(contact.multiplier_mm, again.multiplier_mm);
        }
      }
      rests += knew && run.state.contact_count > 0;
      ruptures += is.ruptured;
      ++ticks;
    }
  }
  EXPECT_GT(rests, ticks / 10);
  EXPECT_GT(ruptures, 0);
}

TEST(Proxy, RestCacheIsKeyedByToolAndPosition) {
  const Point<Patient> position(1, 2, 3);
  const ToolSphere sphere{{0, 0, 1}, 0.5};
  const RestingContacts::Constraint plane{{0, 0, 1}, 2.5, 4, 0};
  RestingContacts touched;
  EXPECT_TRUE(touched.find(position, {}, {&sphere, 1}).empty());
  touched.store(position, {}, {&sphere, 1}, {&plane, 1});
  ASSERT_EQ(touched.find(position, {}, {&sphere, 1}).size(), 1u);
  EXPECT_EQ(touched.find(position, {}, {&sphere, 1})[0].surface, 4);
  EXPECT_TRUE(touched.find({1, 2, 3.0000001}, {}, {&sphere, 1}).empty());
  EXPECT_TRUE(touched.find(position, SurfaceSet(1), {&sphere, 1}).empty());
  const ToolSphere wider{{0, 0, 1}, 0.6}, turned{{0, 1, 0}, 0.5}, capsule{{0, 0, 1}, 0.5, {0, 0, 2}};
  for (const ToolSphere& other : {wider, turned, capsule})
    EXPECT_TRUE(touched.find(position, {}, {&other, 1}).empty());
  const std::array two{sphere, sphere};
  EXPECT_TRUE(touched.find(position, {}, two).empty());
  touched.invalidate();
  EXPECT_TRUE(touched.find(position, {}, {&sphere, 1}).empty());
}

// whatever is touched, the work of a tick is bounded and the penetration within tolerance
TEST(Proxy, RandomPathsOverRandomSurfacesStayOutside) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> unit(0, 1), about(-1, 1);
  for (int scene = 0; scene < 24; ++scene) {
    ProxyRun run;
    const auto turned = Eigen::AngleAxisd(3 * unit(random), random_direction(random).eigen());
    for (int s = 0; s < 3; ++s) {
      // overlapping or separate balls and rods, well inside the volume
      const Eigen::Vector3d centre(3 * about(random), 3 * about(random), 3 * about(random));
      const Eigen::Vector3d axis = random_direction(random).eigen();
      const double radius_mm = 1 + 2 * unit(random);
      const double half_length_mm = unit(random) < 0.5 ? 3 : 0;
      run.surfaces.push_back(make_contact_surface(
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
      // at most 0.5 m/s at 1 kHz, attracted to the centre
      velocity_mm = velocity_mm * 0.97 + random_direction(random) * 0.06 + (Point<Patient>() - tip) * 0.002;
      if (velocity_mm.norm() > 0.5) velocity_mm = velocity_mm * (0.5 / velocity_mm.norm());
      tip += velocity_mm;
      run.at(tip);
      ASSERT_TRUE(run.result.force_N.all_finite());
      ASSERT_LT(run.deepest_mm, kProxySettings.max_penetration_mm) << "scene " << scene << ", tick " << n;
    }
  }
}

}  // namespace
}  // namespace palpate
