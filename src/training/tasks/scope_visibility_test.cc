#include "palpate/tasks/scope_visibility.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "contact/test_model.h"

namespace palpate {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

Eigen::Vector3d some_direction(std::mt19937_64& random) {
  std::normal_distribution<double> part;
  return Eigen::Vector3d(part(random), part(random), part(random)).normalized();
}

std::array<double, 3> numbers(const Eigen::Vector3d& v) {
  return {v[0], v[1], v[2]};
}

/// A tick in which the second device's scope looks from an eye point along a direction, both in the patient
/// frame.
TickRecord looking(const Model& model, const ScopeOptics& optics, const Eigen::Vector3d& eye,
                   const Eigen::Vector3d& view_direction, const Eigen::Quaterniond& turned) {
  TickRecord tick;
  tick.devices = 2;
  tick.rotation_applied_wxyz = {turned.w(), turned.x(), turned.y(), turned.z()};
  const auto X = rotated_object_pose(model.X_WorldPatient, turned);
  const Eigen::Quaterniond rotation =
      attitude_looking_along(optics, X * Vector<Patient>(view_direction), X * Vector<Patient>(0, 0.3, 1));
  tick.device[1].orientation_wxyz = {rotation.w(), rotation.x(), rotation.y(), rotation.z()};
  const Point<World> tip = X * Point<Patient>(eye) - Vector<World>(rotation * camera_of(optics));
  tick.device[1].tip_patient_mm = numbers((X.inverse() * tip).eigen());
  return tick;
}

Model nothing_touchable() {
  Model model = testing::ball_model();
  for (Tissue& tissue : model.tissues) tissue.touchable = false;
  return model;
}

TEST(HeldToLook, LooksThereWithItsShaftToTheSideThatIsAskedFor) {
  std::mt19937_64 random(test::test_seed() + 41);
  for (int n = 0; n < 1000; ++n) {
    const ScopeOptics optics{90.0 * (n % 10) / 9, 8};
    const Vector<World> view_direction(some_direction(random)), upper(some_direction(random));
    const Eigen::Quaterniond rotation = attitude_looking_along(optics, view_direction, upper);
    EXPECT_NEAR(rotation.norm(), 1, 1e-12);
    EXPECT_LT((rotation * view_direction_of(optics) - view_direction.eigen()).norm(), 1e-12);
    // the shaft is as close to that side as its angle to the viewing direction allows
    const Eigen::Vector3d shaft = rotation * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d across =
        (upper.eigen() - upper.dot(view_direction) * view_direction.eigen()).normalized();
    const double lean = optics.lean_deg * kDegree;
    EXPECT_LT((shaft - (across * std::sin(lean) - view_direction.eigen() * std::cos(lean))).norm(), 1e-7);
  }
  // looking straight away from that side, any rotation is valid
  const Eigen::Quaterniond down =
      attitude_looking_along({30, 8}, Vector<World>(0, 0, -1), Vector<World>(0, 0, 1));
  EXPECT_LT((down * view_direction_of({30, 8}) + Eigen::Vector3d::UnitZ()).norm(), 1e-12);
}

TEST(ScopeVisibility, FieldOfViewIsRoundForAnyOrientation) {
  std::mt19937_64 random(test::test_seed() + 43);
  const Model model = nothing_touchable();
  for (int n = 0; n < 500; ++n) {
    const ScopeOptics optics{90.0 * (n % 7) / 6, 1.0 * (n % 20)};
    const ScopeVisibility sight(optics, model);
    const Eigen::Vector3d eye = 20 * some_direction(random), look = some_direction(random);
    const Eigen::Quaterniond turned(Eigen::AngleAxisd(0.01 * n, some_direction(random)));
    const TickRecord tick = looking(model, optics, eye, look, turned);
    const Eigen::Vector3d lateral = look.cross(some_direction(random)).normalized();
    for (const double angle : {0.0, 39.99, 40.01, 90.0, 180.0}) {
      const Eigen::Vector3d displacement =
          std::cos(angle * kDegree) * look + std::sin(angle * kDegree) * lateral;
      EXPECT_EQ(sight.is_visible(tick, eye + (1 + n % 50) * displacement), angle < 40) << angle;
    }
  }
}

TEST(ScopeVisibility, TouchableTissueOccludes) {
  const Model model = testing::ball_model({0.6, 0.6, 0.6});
  const ScopeVisibility sight({30, 8}, model);
  std::mt19937_64 random(test::test_seed() + 47);
  for (int n = 0; n < 300; ++n) {
    const Eigen::Vector3d out = some_direction(random),
                          lateral = out.cross(some_direction(random)).normalized();
    const double far_mm = 18 + n % 30;
    const Eigen::Vector3d eye = far_mm * out;
    // on a visible ball: the part on this side of the tangent planes through the eye
    const double border = std::acos(testing::kBoneRadius_mm / far_mm);
    for (const double beyond : {-0.2, 0.2}) {
      const double angle = border + beyond;
      const Eigen::Vector3d position =
          testing::kBoneRadius_mm * (std::cos(angle) * out + std::sin(angle) * lateral);
      const Eigen::Vector3d view_direction = (position - eye).normalized();
      const TickRecord tick = looking(model, {30, 8}, eye, view_direction, Eigen::Quaterniond::Identity());
      EXPECT_EQ(sight.is_visible(tick, position), beyond < 0) << far_mm;
    }
    // fat, which is not touchable, does not occlude
    const TickRecord across = looking(model, {30, 8}, 23 * out, -out, Eigen::Quaterniond::Identity());
    EXPECT_TRUE(sight.is_visible(across, testing::kBoneRadius_mm * out));
    EXPECT_FALSE(sight.is_visible(across, -testing::kBoneRadius_mm * out));
    // from inside tissue nothing is visible, however near
    const TickRecord within = looking(model, {30, 8}, 14 * out, out, Eigen::Quaterniond::Identity());
    EXPECT_FALSE(sight.is_visible(within, 14.2 * out));
  }
}

TEST(ScopeVisibility, NothingIsVisibleAtAnUnknownPose) {
  const Model model = nothing_touchable();
  const ScopeVisibility sight({0, 0}, model);
  const TickRecord good = looking(model, {0, 0}, {0, 0, 20}, {0, 0, -1}, Eigen::Quaterniond::Identity());
  EXPECT_TRUE(sight.is_visible(good, {0, 0, 0}));
  EXPECT_FALSE(sight.is_visible(good, {0, 0, 20})) << "its eye itself";
  EXPECT_FALSE(sight.is_visible(good, {0, 0, -1e300}));
  TickRecord bad = good;
  bad.device[1].tip_patient_mm[1] = kNoValue;
  EXPECT_FALSE(sight.is_visible(bad, {0, 0, 0}));
  bad = good;
  bad.device[1].orientation_wxyz = {0, 0, 0, 0};
  EXPECT_FALSE(sight.is_visible(bad, {0, 0, 0}));
  bad = good;
  bad.device[1].tip_patient_mm = {1e300, 0, 20};
  EXPECT_FALSE(sight.is_visible(bad, {1e300, 0, 0}));
  bad = good;
  bad.devices = 1;
  EXPECT_FALSE(sight.is_visible(bad, {0, 0, 0}));
}

}  // namespace
}  // namespace palpate
