#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "contact/capsule_row.h"
#include "contact/test_proxy_surfaces.h"
#include "palpate/contact/proxy.h"

/// Rotation of the tool: surfaces hit by a lever on its arc push the tip away, which is felt as a force.
namespace palpate {
namespace {

using testing::cube_grid;
using testing::make_contact_surface;
using testing::ProxyRun;
using testing::random_direction;

constexpr unsigned kTurnSeed = 57;

Eigen::Quaterniond about_y(double angle_rad) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitY()));
}

// a plate of 2 mm in the plane z = 0
ContactSurface plate() {
  ContactSurface surface = make_contact_surface(cube_grid(14, {0.5, 0.5, 0.5}),
                                                [](const Eigen::Vector3d& p) { return std::abs(p.z()) - 1; });
  surface.stiffness_N_per_mm = 2;
  return surface;
}

// a lever with a sphere at its end, from the tip on the left to above the plate
ProxyRun lever_over_plate(double lever_mm, double radius_mm, double height_mm) {
  ProxyRun run;
  run.surfaces = {plate()};
  run.parts = {{Vector<Patient>(lever_mm, 0, 0), radius_mm}};
  run.at(Point<Patient>(-lever_mm, 0, height_mm));
  return run;
}

TEST(ToolTurn, LeverPassesNoPlateAndGivesTorque) {
  struct Case {
    double lever_mm, radius_mm, speed_rad_s, tick_s;
  };
  for (const Case& turned : {Case{40, 0, 12, 1e-3}, Case{40, 0, 3, 4e-3}, Case{100, 0, 20, 4e-3},
                             Case{100, 1.5, 20, 4e-3}, Case{100, 0.5, 20, 1e-3}}) {
    SCOPED_TRACE(std::to_string(turned.lever_mm) + " mm, " + std::to_string(turned.speed_rad_s) + " rad/s");
    const double height_mm = 4.25 + turned.radius_mm;
    ProxyRun run = lever_over_plate(turned.lever_mm, turned.radius_mm, height_mm);
    const Point<Patient> tip(-turned.lever_mm, 0, height_mm);
    // until the sphere in the operator's pose is 3.25 mm below the middle of the plate
    const double end_rad = std::asin((height_mm + 3.25) / turned.lever_mm);
    for (double angle = 0; angle < end_rad; angle += turned.speed_rad_s * turned.tick_s)
      run.at(tip, about_y(angle));
    for (int n = 0; n < 40; ++n) run.at(tip, about_y(end_rad));
    EXPECT_FALSE(run.result.lagging);
    EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);

    // the sphere lies on the plate in the operator's attitude, and the tip is pushed up by the difference
    const double pushed_mm = 3.25 + 1 + turned.radius_mm;
    const Eigen::Vector3d offset = about_y(end_rad) * Eigen::Vector3d(turned.lever_mm, 0, 0);
    EXPECT_EQ(run.state.attitude.coeffs(), about_y(end_rad).normalized().coeffs());
    EXPECT_NEAR(run.state.position.z(), height_mm + pushed_mm, 0.01);
    EXPECT_NEAR(run.result.force_N.z(), 2 * pushed_mm, 0.02);
    EXPECT_NEAR(run.result.force_N.x(), 0, 1e-2);
    EXPECT_NEAR(run.result.torque_Nmm.y(), -offset.x() * run.result.force_N.z(),
                1e-3 * turned.lever_mm * run.result.force_N.z());
    ASSERT_EQ(run.state.contact_count, 1);
    EXPECT_EQ(run.state.contacts[0].part, 0);

    // back again
    for (double angle = end_rad; angle > 0; angle -= turned.speed_rad_s * turned.tick_s)
      run.at(tip, about_y(angle));
    for (int n = 0; n < 40; ++n) run.at(tip, about_y(0));
    EXPECT_EQ(run.state.position, tip);
    EXPECT_EQ(run.result.force_N, Vector<Patient>());
  }
}

TEST(ToolTurn, RemainingTurnContinuesInTheNextTick) {
  // a third of a turn in one tick, without obstacles
  ProxyRun run;
  run.surfaces = {plate()};
  run.parts = {{Vector<Patient>(100, 0, 0), 1}};
  const Point<Patient> tip(0, 0, 500);
  run.at(tip);
  int ticks = 0;
  double before = 0;
  do {
    run.at(tip, about_y(2));
    ASSERT_EQ(run.state.position, tip);
    const double turned = run.state.attitude.angularDistance(about_y(0));
    EXPECT_GT(turned, before);
    before = turned;
    ++ticks;
  } while (run.result.lagging && ticks < 100);
  EXPECT_GT(ticks, 2);
  EXPECT_LT(ticks, 20);
  EXPECT_EQ(run.state.attitude.coeffs(), about_y(2).normalized().coeffs());
}

TEST(ToolTurn, BlockedAttitudeLagsBehind) {
  // a floor, a ceiling 2 mm above it, and a bar whose ends both touch at asin(0.5 / 2)
  ProxyRun run;
  run.surfaces = {
      make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return p.z(); }),
      make_contact_surface(cube_grid(9, {0.5, 0.5, 0.5}),
                           [](const Eigen::Vector3d& p) { return 2 - p.z(); })};
  run.parts = {{Vector<Patient>(2, 0, 0), 0.5}, {Vector<Patient>(-2, 0, 0), 0.5}};
  const Point<Patient> tip(0, 0, 1);
  run.at(tip);
  const double max_rad = std::asin(0.25);
  for (double angle = 0; angle < 1.4; angle += 0.02) run.at(tip, about_y(angle));
  EXPECT_TRUE(run.result.wedged);
  EXPECT_NEAR(run.state.attitude.angularDistance(about_y(0)), max_rad, 0.01);
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
  // the operator's tool is free there, but the proxy's does not jump out of the gap
  for (int n = 0; n < 20; ++n) run.at({0, 0, 30}, about_y(1.4));
  EXPECT_LT(run.state.position.z(), 2);
  // back in the gap and level, the proxy follows and is released where it entered
  for (int n = 0; n < 40; ++n) run.at(tip);
  EXPECT_FALSE(run.result.wedged);
  EXPECT_EQ(run.state.position, tip);
  EXPECT_EQ(run.state.attitude.angularDistance(about_y(0)), 0);
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm);
}

TEST(ToolTurn, PointToolIgnoresTurns) {
  SCOPED_TRACE("seed " + std::to_string(kTurnSeed));
  std::mt19937 random(kTurnSeed);
  ProxyRun still, turned;
  still.surfaces = turned.surfaces = {plate()};
  still.parts = turned.parts = {{{}, 0.7}};
  for (int n = 0; n < 400; ++n) {
    const Point<Patient> tip(0.01 * n - 2, 0, 3 - 0.01 * n);
    still.at(tip);
    turned.at(tip, Eigen::Quaterniond(Eigen::AngleAxisd(0.1 * n, random_direction(random).eigen())));
    ASSERT_EQ(turned.state.position, still.state.position);
    ASSERT_EQ(turned.result.force_N, still.result.force_N);
  }
}

// a shaft whose middle meets an obstacle between its ends, rotated into it and moved
TEST(ToolTurn, ShaftTouchesBetweenItsEnds) {
  const double reach_mm = 4;
  ProxyRun run;
  run.surfaces = {make_contact_surface(
      cube_grid(9, {0.4, 0.4, 0.4}), [](const Eigen::Vector3d& p) { return p.norm() - 2; }, reach_mm)};
  run.surfaces[0].stiffness_N_per_mm = 2;
  run.parts = {{{}, 1, Vector<Patient>(60, 0, 0)}};
  // starts above the ball, which is 20 mm along the shaft, and ends with the operator's shaft below it
  const Point<Patient> tip(-20, 0, 8);
  run.at(tip);
  const double end_rad = std::asin(12.0 / 20);
  for (double angle = 0; angle < end_rad; angle += 0.01) run.at(tip, about_y(angle));
  // the rotation pushes it farther than necessary in the end; the excess is released by slip
  for (int n = 0; n < 60 || (run.result.lagging && n < 1000); ++n) run.at(tip, about_y(end_rad));
  EXPECT_FALSE(run.result.lagging);
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm + kProxySettings.max_row_gap_mm);
  EXPECT_EQ(run.state.attitude.coeffs(), about_y(end_rad).normalized().coeffs());

  // it touches the ball from above, one radius from it, and is pushed along its own normal
  const Eigen::Vector3d axis = about_y(end_rad) * Eigen::Vector3d::UnitX();
  const Eigen::Vector3d normal = axis.cross(Eigen::Vector3d::UnitY());
  ASSERT_EQ(run.state.contact_count, 1);
  const double part = -axis.dot(run.state.position.eigen()) / 60;
  EXPECT_NEAR(run.state.contacts[0].axis_fraction, part, 0.3 / 60);
  const Eigen::Vector3d touching = run.state.position.eigen() + 60 * part * axis;
  EXPECT_NEAR(touching.norm(), 3, 0.03);
  EXPECT_NEAR((touching.normalized() - normal).norm(), 0, 0.03);
  const double pushed_mm = 3 - normal.dot(tip.eigen());
  EXPECT_NEAR(run.result.force_N.norm(), 2 * pushed_mm, 0.1);
  EXPECT_NEAR((run.result.force_N.normalized().eigen() - normal).norm(), 0, 0.05);
  const Eigen::Vector3d torque = (60 * part * axis - normal).cross(run.result.force_N.eigen());
  EXPECT_LT((run.result.torque_Nmm.eigen() - torque).norm(), 0.02 * torque.norm());

  // released, then lowered onto the ball while level
  for (double angle = end_rad; angle > 0; angle -= 0.01) run.at(tip, about_y(angle));
  for (int n = 0; n < 60; ++n) run.at(tip);
  EXPECT_EQ(run.state.position, tip);
  run.lead(tip, {-20, 0, -5}, 0.05);
  EXPECT_NEAR(run.state.position.z(), 3, 0.02);
  EXPECT_NEAR(run.result.force_N.z(), 2 * 8, 0.1);
  EXPECT_LT(run.deepest_mm, kProxySettings.max_penetration_mm + kProxySettings.max_row_gap_mm);
}

// surfaces met on the arcs of one to four spheres
TEST(ToolTurn, RandomTurnsOverRandomSurfacesStayOutside) {
  SCOPED_TRACE("seed " + std::to_string(kTurnSeed));
  std::mt19937 random(kTurnSeed);
  std::uniform_real_distribution<double> unit(0, 1), about(-1, 1);
  int in_contact = 0, blocked = 0;
  constexpr int kWithoutCapsules = 12, kScenes = 18;
  for (int scene = 0; scene < kScenes; ++scene) {
    ProxyRun run;
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(3 * unit(random), random_direction(random).eigen()).toRotationMatrix();
    for (int s = 0; s < 3; ++s) {
      const double x = 3 * about(random), y = 3 * about(random), z = 3 * about(random);
      const Eigen::Vector3d centre(x, y, z), axis = random_direction(random).eigen();
      const double radius_mm = 1 + 2 * unit(random), half_length_mm = s == 0 ? 3 : 0;
      run.surfaces.push_back(make_contact_surface(
          cube_grid(14, {0.277, 0.277, 1.0}, turn),
          [=](const Eigen::Vector3d& p) {
            const Eigen::Vector3d v = p - centre;
            return (v - axis * std::clamp(axis.dot(v), -half_length_mm, half_length_mm)).norm() - radius_mm;
          },
          2));
    }
    // a lever from the tip to the surfaces, or a cluster of spheres around it
    const double lever_mm = scene % 2 == 0 ? 100 * unit(random) : 0;
    run.parts.clear();
    for (int k = 0; k <= scene % 4; ++k)
      run.parts.push_back(
          {Vector<Patient>(lever_mm, 0, 0) + random_direction(random) * 4.0, 0.8 * unit(random)});
    if (scene >= kWithoutCapsules) {
      run.parts[0].radius_mm = 0.3 + 0.7 * unit(random);
      run.parts[0].axis_mm = lever_mm > 0 ? run.parts[0].offset_mm * -0.9 : random_direction(random) * 8;
    }
    Point<Patient> midpoint(0, 0, 16);
    Eigen::Quaterniond attitude = Eigen::Quaterniond::Identity();
    Vector<Patient> velocity_mm, spin_rad;
    for (int n = 0; n < 1000; ++n) {
      // the end of the lever is attracted to the centre and rotates about the tip by up to 0.02 rad per tick
      velocity_mm =
          velocity_mm * 0.97 + random_direction(random) * 0.06 + (Point<Patient>() - midpoint) * 0.002;
      if (velocity_mm.norm() > 0.5) velocity_mm = velocity_mm * (0.5 / velocity_mm.norm());
      midpoint += velocity_mm;
      spin_rad = spin_rad * 0.95 + random_direction(random) * (lever_mm > 0 ? 0.002 : 0.02);
      const double angle = spin_rad.norm();
      attitude = (Eigen::AngleAxisd(angle, spin_rad.normalized().eigen()) * attitude).normalized();
      run.at(midpoint - Vector<Patient>(lever_mm, 0, 0), attitude);
      ASSERT_TRUE(run.result.force_N.all_finite());
      const double max_mm = scene < kWithoutCapsules
                                ? kProxySettings.max_penetration_mm
                                : kProxySettings.max_penetration_mm + kProxySettings.max_row_gap_mm;
      ASSERT_LT(run.deepest_mm, max_mm) << "scene " << scene << ", tick " << n;
      in_contact += run.state.contact_count > 0;
      blocked += run.result.wedged;
    }
  }
  EXPECT_GT(in_contact, 3000);
  EXPECT_LT(blocked, in_contact / 10);
}

}  // namespace
}  // namespace palpate
