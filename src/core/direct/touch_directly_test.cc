#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "contact/test_model.h"
#include "palpate/direct/direct_methods.h"

namespace palpate {
namespace {

using testing::kBoneRadius_mm;

Vector<Patient> random_vector(std::mt19937& random) {
  std::normal_distribution<double> normal(0, 30);
  return {normal(random), normal(random), normal(random)};
}

TEST(NormalForce, PushesAgainstTheGradientInProportionToTheField) {
  FieldSample sample;
  sample.value = 0.25;
  sample.gradient = Vector<Patient>(0, 0, -0.4);
  EXPECT_LT((normal_force(sample, 4) - Vector<Patient>(0, 0, 1)).norm(), 1e-12);
  sample.gradient = Vector<Patient>();
  EXPECT_EQ(normal_force(sample, 4), Vector<Patient>()) << "no direction, no force";
}

TEST(PseudoFriction, IsTangentialOpposesTheMotionAndIsClampedTwice) {
  std::mt19937 random(11);
  Tissue tissue;
  tissue.friction = 0.2;
  tissue.friction_damping_N_s_per_mm = 0.01;
  tissue.friction_max_N = 0.3;
  for (int i = 0; i < 1000; ++i) {
    const Vector<Patient> v = random_vector(random), normal_N = random_vector(random) / 20;
    const Vector<Patient> f = pseudo_friction(tissue, v, normal_N);
    EXPECT_NEAR(f.dot(normal_N), 0, 1e-9);
    EXPECT_LE(f.dot(v), 1e-12) << "takes energy";
    EXPECT_LE(f.norm(), 0.3 + 1e-12);
    EXPECT_LE(f.norm(), 0.2 * normal_N.norm() + 1e-12);
    // below the limits it is viscous: twice the speed, twice the force
    const Vector<Patient> slow = v * 1e-3;
    EXPECT_LT(
        (pseudo_friction(tissue, slow * 2, normal_N) - pseudo_friction(tissue, slow, normal_N) * 2).norm(),
        1e-9);
  }
  EXPECT_EQ(pseudo_friction(tissue, Vector<Patient>(5, 0, 0), Vector<Patient>()), Vector<Patient>());
  EXPECT_EQ(pseudo_friction(tissue, Vector<Patient>(), Vector<Patient>(0, 0, 1)), Vector<Patient>());
}

TEST(TouchDirectly, ReportsEveryPointInside) {
  Model model = testing::with_ramps(testing::ball_model(), 4);
  model.tools[0].points_mm = {{0, 0, 0}, {0, 0, -1}, {0, 0, 5}};
  const TickContext tick{model, ForceMethod::kTrilinear, false, false, 1e-3, {}, {}};
  const DeviceParameters device;
  const DeviceContext context{
      model.tools[0], device, Eigen::Matrix3d::Identity(), {0, 0, kBoneRadius_mm - 0.5}, {}};
  const ToolContact contact = touch_directly(tick, context);
  const auto is_used = [](const ContactPoint& point) { return point.label != 0; };
  ASSERT_EQ(std::ranges::count_if(contact.contacts, is_used), 2);
  EXPECT_EQ(contact.contacts[0].part, 1);
  EXPECT_EQ(contact.contacts[1].part, 0);
  EXPECT_NEAR(contact.contacts[0].force_N, 1.5 * 1.5, 0.1);
  EXPECT_NEAR(contact.contacts[1].force_N, 1.5 * 0.5, 0.1);
  EXPECT_NEAR(contact.requested.force_N.z(), contact.contacts[0].force_N + contact.contacts[1].force_N, 1e-6);
  EXPECT_EQ(contact.contacts[0].position, (Point<Patient>(0, 0, kBoneRadius_mm - 1.5)));
}

}  // namespace
}  // namespace palpate
