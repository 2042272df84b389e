#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "contact/test_proxy_floor.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::Distance;
using testing::floor_mm;
using testing::labelled;
using testing::largest_change_N;
using testing::make_contact_surface;
using testing::ProxyRun;

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
      run.parts = {{{}, radius_mm}};
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
      run.parts = {{{}, 0.5}, {{0, 0, 4}, 1}};
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
  const std::array<ToolPart, 1> point{};
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
  run.parts = {{{}, 0.5}};
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

}  // namespace
}  // namespace palpate
