#include <gtest/gtest.h>

#include <random>

#include "palpate/contact/haptics.h"

namespace palpate {
namespace {

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

TEST(Viscosity, TakesEnergyAndFadesTowardsTheSurface) {
  std::mt19937 random(7);
  Tissue tissue;
  tissue.viscosity_N_s_per_mm = 0.002;
  for (int i = 0; i < 100; ++i) {
    const Vector<Patient> v = random_vector(random);
    EXPECT_LE(viscous_force(tissue, v, 0.7).dot(v), 0);
    EXPECT_LT((viscous_force(tissue, v, 5) - v * -0.002).norm(), 1e-12) << "full inside, never more";
  }
  EXPECT_EQ(viscous_force(tissue, Vector<Patient>(10, 0, 0), 0), Vector<Patient>());
  EXPECT_EQ(viscous_force(tissue, Vector<Patient>(10, 0, 0), -1), Vector<Patient>());
}

TEST(PseudoFriction, IsTangentialOpposesTheMotionAndKeepsBothCaps) {
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

}  // namespace
}  // namespace palpate
