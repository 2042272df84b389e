#include "verification/accuracy_meter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "verification/smoothed_indicator.h"

namespace palpate {
namespace {

using Eigen::Vector3d;

constexpr double kStep = kChoppinessStep_mm;

TEST(DegreesBetween, MeasuresEveryAngleAndCountsNoDirectionAsTheOpposite) {
  for (const double degrees : {0.0, 1e-6, 0.01, 30.0, 90.0, 179.999, 180.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    const Vector3d turned(2 * std::cos(angle), 2 * std::sin(angle), 0);
    EXPECT_NEAR(degrees_between(Vector3d::UnitX(), turned), degrees, 1e-9);
  }
  EXPECT_EQ(degrees_between(Vector3d::Zero(), Vector3d::UnitX()), 180);
}

TEST(AddSpread, GivesMeanP99AndMax) {
  std::vector<double> values;
  for (int n = 200; n >= 1; --n) values.push_back(n);
  std::vector<Figure> figures;
  add_spread(figures, "a/b", "deg", values);
  ASSERT_EQ(figures.size(), 3u);
  EXPECT_EQ(figures[0].name, "a/b/mean");
  EXPECT_EQ(figures[0].value, 100.5);
  EXPECT_EQ(figures[1].name, "a/b/p99");
  EXPECT_EQ(figures[1].value, 198);
  EXPECT_EQ(figures[2].name, "a/b/max");
  EXPECT_EQ(figures[2].value, 200);
  EXPECT_EQ(figures[2].n, 200u);
  EXPECT_EQ(figures[2].unit, "deg");

  figures.clear();
  add_spread(figures, "a/b", "deg", values, kWithoutMean);
  EXPECT_EQ(figures.size(), 2u);
  add_spread(figures, "a/b", "deg", {});
  EXPECT_EQ(figures.size(), 2u);
}

TEST(ConstantDepthPath, IsAGreatCircleOnASphere) {
  const Shape sphere = Shape::sphere({}, 20);
  const Point<Patient> start(0, 12.6, 15.4);
  const double radius = start.eigen().norm();
  const auto path = constant_depth_path(sphere, start, {3, 1, 2}, kStep, 1000);
  ASSERT_EQ(path.size(), 1001u);
  EXPECT_EQ(path[0], start);
  const Vector3d axis = path[0].eigen().cross(path[1].eigen()).normalized();
  for (std::size_t n = 1; n < path.size(); ++n) {
    EXPECT_NEAR(path[n].eigen().norm(), radius, 1e-9);
    EXPECT_NEAR((path[n] - path[n - 1]).norm(), kStep, 1e-8);
    EXPECT_NEAR(axis.dot(path[n].eigen()), 0, 1e-7);
  }
  const double turned = std::acos(path.front().eigen().dot(path.back().eigen()) / (radius * radius));
  EXPECT_NEAR(turned * radius, 1000 * kStep, 1e-6);
}

TEST(ConstantDepthPath, KeepsItsDepthAndItsStepsOnATorus) {
  const Shape torus = Shape::torus({}, {0.36, 0.48, 0.8}, 20, 8);
  const Point<Patient> start(13, -21, 4.5);
  const double depth = torus.distance_mm(start);
  const auto path = constant_depth_path(torus, start, {0, 1, 0}, kStep, 2000);
  for (std::size_t n = 1; n < path.size(); ++n) {
    EXPECT_NEAR(torus.distance_mm(path[n]), depth, 1e-8);
    EXPECT_NEAR((path[n] - path[n - 1]).norm(), kStep, 1e-7);
  }
  // geodesic: the path bends only along the normal
  for (std::size_t n = 1; n + 1 < path.size(); ++n) {
    const Vector3d bend = (path[n + 1] - path[n]).eigen() - (path[n] - path[n - 1]).eigen();
    const Vector3d normal = torus.normal(path[n]).eigen();
    EXPECT_LT((bend - bend.dot(normal) * normal).norm(), 1e-7);
  }
}

TEST(ForceChanges, FollowFromAKnownGradient) {
  // linear value and constant direction: |g . u| per step along u
  const Vector<Patient> gradient(0.1, -0.05, 0.2);
  const Sampler ramp = [&](const Point<Patient>& p) {
    return FieldSample{0.5 + gradient.dot(p - Point<Patient>()), gradient};
  };
  const auto path =
      constant_depth_path(Shape::half_space({}, {0, 0, 1}), {0.1, 0.2, 0.3}, {3, 4, 0}, kStep, 100);
  const double expected = 100 * std::abs(gradient.dot(Vector<Patient>(0.6, 0.8, 0))) * kStep;
  const auto changes = force_changes_percent(ramp, path);
  ASSERT_EQ(changes.size(), 100u);
  for (const double change : changes) EXPECT_NEAR(change, expected, 1e-9);
}

TEST(ForceChanges, EqualTheCurvatureOfABall) {
  const double radius = 19.6;
  const Sampler ball = [](const Point<Patient>& p) {
    return FieldSample{smoothed_ball(p.eigen().norm(), 20, 1.5), Vector<Patient>(-p.eigen())};
  };
  const auto path = constant_depth_path(Shape::sphere({}, 20), {radius, 0, 0}, {0, 1, 1}, kStep, 500);
  // a constant force that rotates by step / radius
  const double expected = 100 * smoothed_ball(radius, 20, 1.5) * kStep / radius;
  for (const double change : force_changes_percent(ball, path)) EXPECT_NEAR(change, expected, 1e-6);
}

TEST(ForceChanges, DetectJumpsOfMagnitudeAndDirection) {
  const auto path =
      constant_depth_path(Shape::half_space({}, {0, 0, 1}), {-0.5, 0, 0}, {1, 0, 0}, kStep, 100);
  const auto jump_of = [&](const FieldSample& before, const FieldSample& after) {
    const auto changes =
        force_changes_percent([&](const Point<Patient>& p) { return p.x() < 0.003 ? before : after; }, path);
    EXPECT_EQ(std::count(changes.begin(), changes.end(), 0.0), 99);
    return *std::max_element(changes.begin(), changes.end());
  };
  EXPECT_NEAR(jump_of({0.5, {1, 0, 0}}, {0.53, {1, 0, 0}}), 3, 1e-9);
  EXPECT_NEAR(jump_of({0.5, {1, 0, 0}}, {0.5, {0, 2, 0}}), 50 * std::numbers::sqrt2, 1e-9);
  // without a gradient there is no direction, and no force
  EXPECT_NEAR(jump_of({0.5, {1, 0, 0}}, {0.5, {0, 0, 0}}), 50, 1e-9);
}

TEST(NearestVoxel, ChangesAtTheHalves) {
  EXPECT_TRUE(same_nearest_voxel({2.49, 7, -0.49}, {1.5, 7.3, 0.2}));
  EXPECT_FALSE(same_nearest_voxel({2.49, 7, 0}, {2.5, 7, 0}));
  EXPECT_FALSE(same_nearest_voxel({2, 7, -0.51}, {2, 7, -0.5}));
  EXPECT_FALSE(same_nearest_voxel({2, 6.499, 0}, {2, 6.501, 0}));
}

}  // namespace
}  // namespace palpate
