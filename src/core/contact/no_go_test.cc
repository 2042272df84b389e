#include "palpate/contact/no_go.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "base/test_seed.h"
#include "contact/test_proxy_surfaces.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::make_contact_surface;

const std::vector<ToolPart> kPointTool{ToolPart{}};

NoGoRegion plane_region(const Vector<Patient>& outward, double keep_away_mm, double stiffness,
                        const Point<Patient>& at = {}) {
  return {"plane", NoGoPlane{at, outward.normalized()}, keep_away_mm, stiffness};
}

NoGoForce pushed(const std::vector<NoGoRegion>& regions, const Point<Patient>& tip, double largest = 2,
                 const DistanceTrees& distances = {}, const std::vector<ToolPart>& tool = kPointTool) {
  return no_go_force(regions, distances, tool, tip, largest);
}

// a ball of 6 mm radius as a structure that is not felt
DistanceTrees ball_structure() {
  const auto surface =
      make_contact_surface(
          cube_grid(9, {0.36, 0.36, 0.7}), [](const Eigen::Vector3d& p) { return p.norm() - 6; }, 4)
          .surface;
  return {{{7, std::make_shared<const SurfaceTree>(surface), false}}, 20};
}

TEST(NoGo, ForceIsStiffnessTimesDepthAndZeroOutside) {
  const std::vector<NoGoRegion> floor{plane_region({0, 0, 1}, 1.5, 0.8)};
  EXPECT_EQ(pushed(floor, {0, 0, 1.6}).region, -1);
  EXPECT_EQ(pushed(floor, {0, 0, 1.6}).force_N, Vector<Patient>());
  for (const double z : {1.4, 0.0, -3.0}) {
    const NoGoForce force = pushed(floor, {4, -2, z});
    EXPECT_EQ(force.region, 0);
    EXPECT_NEAR(force.depth_mm, 1.5 - z, 1e-12);
    EXPECT_NEAR((force.force_N - Vector<Patient>(0, 0, 0.8 * (1.5 - z))).norm(), 0, 1e-12);
    EXPECT_NEAR(force.stored_mJ, 0.5 * 0.8 * (1.5 - z) * (1.5 - z), 1e-12);
    EXPECT_NEAR(force.stiffness_N_per_mm, 0.8, 1e-12);
  }
  // a spherical region and a structure of the same shape
  const DistanceTrees distances = ball_structure();
  const std::vector<NoGoRegion> ball{{"ball", NoGoSphere{{}, 6}, 1, 0.5}};
  const std::vector<NoGoRegion> structure{{"structure", NoGoStructure{7, 0}, 1, 0.5}};
  for (const double r : {8.0, 6.5, 5.0, 2.0}) {
    const Point<Patient> tip(0.6 * r, 0, 0.8 * r);
    const Vector<Patient> truth = Vector<Patient>(0.6, 0, 0.8) * (0.5 * std::max(0.0, 7 - r));
    EXPECT_NEAR((pushed(ball, tip, 2, distances).force_N - truth).norm(), 0, 1e-12) << r;
    EXPECT_NEAR((pushed(structure, tip, 2, distances).force_N - truth).norm(), 0, 0.12 * truth.norm() + 1e-12)
        << r;
  }
  EXPECT_EQ(pushed({{"not prepared", NoGoStructure{7, -1}, 1, 0.5}}, {}, 2, distances).region, -1);
}

TEST(NoGo, StiffnessIsClampedToTheStableLimit) {
  const NoGoForce force = pushed({plane_region({0, 0, 1}, 0, 20)}, {0, 0, -1}, 0.7);
  EXPECT_LE(force.force_N.norm(), 0.7);
  EXPECT_GE(force.force_N.norm(), 0.62);
  EXPECT_EQ(pushed({plane_region({0, 0, 1}, 0, 20)}, {0, 0, -1}, 0).force_N, Vector<Patient>());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NEAR(pushed({plane_region({0, 0, 1}, 0, 5)}, {0, 0, -1}, nan).force_N.z(), 5, 1e-12)
      << "where nothing is known nothing is capped";
}

// random planes around the origin, which overlap there
std::vector<NoGoRegion> random_regions(std::mt19937& random, int count) {
  std::uniform_real_distribution<double> keep(1, 4), stiffness(0.1, 5), off(-1.5, 1.5);
  std::vector<NoGoRegion> regions;
  for (int n = 0; n < count; ++n) {
    const Vector<Patient> out = testing::random_direction(random);
    const double away = off(random), keep_mm = keep(random);
    regions.push_back(plane_region(out, keep_mm, stiffness(random), Point<Patient>() + out * away));
  }
  return regions;
}

TEST(NoGo, ManyPlanesAreConservativeAndBoundedInStiffness) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(-2, 2);
  constexpr double kMaxStiffness = 2, kStep_mm = 1e-5;
  int encountered = 0;
  for (int n = 0; n < 400; ++n) {
    const auto regions = random_regions(random, 2 + n % 5);
    const double z = any(random), y = any(random), x = any(random);
    const Point<Patient> tip(x, y, z);
    const NoGoForce force = pushed(regions, tip, kMaxStiffness);
    encountered += force.stored_mJ > 0.01;
    const Vector<Patient> displacement = testing::random_direction(random);
    const NoGoForce there = pushed(regions, tip + displacement * kStep_mm, kMaxStiffness);
    const NoGoForce back = pushed(regions, tip - displacement * kStep_mm, kMaxStiffness);
    EXPECT_NEAR((there.stored_mJ - back.stored_mJ) / (2 * kStep_mm), -force.force_N.dot(displacement), 1e-4)
        << n;
    // along any path the force increases by at most the stiffness limit
    EXPECT_LE((back.force_N - there.force_N).dot(displacement) / (2 * kStep_mm), kMaxStiffness * 1.001) << n;
  }
  EXPECT_GT(encountered, 100);
}

TEST(NoGo, OverlappingEqualRegionsActAsOne) {
  const NoGoRegion floor = plane_region({0, 0, 1}, 1, 1.8);
  const double one = pushed({floor}, {}).force_N.z(), two = pushed({floor, floor}, {}).force_N.z();
  EXPECT_GE(two, one);
  EXPECT_LE(two, 2.0) << "of springs side by side it would be twice as much";
  // between two planes closer than the sum of their keep-away distances the force points to the middle
  const std::vector<NoGoRegion> gap{plane_region({0, 0, 1}, 2, 1, {0, 0, -1}),
                                    plane_region({0, 0, -1}, 2, 1, {0, 0, 1})};
  EXPECT_NEAR(pushed(gap, {}).force_N.norm(), 0, 1e-9);
  EXPECT_LT(pushed(gap, {0, 0, 0.2}).force_N.z(), -0.1);
}

TEST(NoGo, ActsOnEveryPartOfTheTool) {
  const std::vector<NoGoRegion> floor{plane_region({0, 0, 1}, 1, 0.5)};
  const std::vector<ToolPart> tool{{{}, 0.5}, {{0, 0, 0}, 0.5, {10, 0, -3}}};
  const NoGoForce force = pushed(floor, {0, 0, 3}, 2, {}, tool);
  EXPECT_NEAR(force.depth_mm, 1.5, 1e-12) << "the shaft's far end";
  EXPECT_NEAR((force.force_N - Vector<Patient>(0, 0, 0.75)).norm(), 0, 1e-12);
  EXPECT_NEAR((force.torque_Nmm - Vector<Patient>(10, 0, -3.5).cross(force.force_N)).norm(), 0, 1e-9);
  // a shaft passing a ball
  const std::vector<NoGoRegion> ball{{"ball", NoGoSphere{{4, 0, 0}, 1}, 1, 0.5}};
  EXPECT_NEAR(pushed(ball, {0, 0, 2}, 2, {}, {{{}, 0.5, {10, 0, 0}}}).depth_mm, 2 + 0.5 - 2, 1e-12);
  // tapered: compared with dense sampling
  const ToolPart cone{{0, 0, 2}, 0.4, {8, 1, -0.5}, 0.9};
  double min_mm = 1e3;
  for (int n = 0; n <= 100000; ++n) {
    const double part = n / 1e5;
    const Vector<Patient> at = cone.offset_mm + cone.axis_mm * part;
    min_mm = std::min(min_mm, (at - Vector<Patient>(4, 0, 0)).norm() - cone.radius_at_mm(part) - 1);
  }
  EXPECT_NEAR(pushed(ball, {}, 2, {}, {cone}).depth_mm, 1 - min_mm, 1e-6);
}

TEST(NoGo, RejectsInvalidRegions) {
  EXPECT_TRUE(check_no_go({}).ok());
  const NoGoRegion good = plane_region({0, 0, 1}, 1, 1);
  EXPECT_TRUE(check_no_go({&good, 1}).ok());
  const auto is_refused = [](const NoGoRegion& region, const std::string& word) {
    const auto checked = check_no_go({&region, 1});
    ASSERT_FALSE(checked.ok());
    EXPECT_NE(checked.error().what.find(word), std::string::npos) << checked.error().what;
    EXPECT_FALSE(checked.error().remedy.empty());
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  is_refused(plane_region({0, 0, 1}, 21, 1), "keep away");
  is_refused(plane_region({0, 0, 1}, nan, 1), "keep away");
  is_refused(plane_region({0, 0, 1}, 1, 0), "stiffness");
  is_refused({"p", NoGoPlane{{}, {0, 0, 2}}, 1, 1}, "plane");
  is_refused({"b", NoGoSphere{{nan, 0, 0}, 2}, 1, 1}, "sphere");
  is_refused({"b", NoGoSphere{{}, 0}, 1, 1}, "sphere");
  const std::vector<NoGoRegion> many(kMaxNoGo + 1, good);
  EXPECT_FALSE(check_no_go(many).ok());
}

}  // namespace
}  // namespace palpate
