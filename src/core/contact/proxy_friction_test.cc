#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "contact/test_proxy_floor.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::kKnee_mm;
using testing::kProxySeed;
using testing::make_contact_surface;
using testing::on_floor;
using testing::ProxyRun;
using testing::random_direction;

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
    run.parts = {{{}, n % 2 == 0 ? 0 : 1.5 * unit(random)}};
    const double above_mm = run.parts[0].radius_mm;
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

}  // namespace
}  // namespace palpate
