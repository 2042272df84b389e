#include <gtest/gtest.h>

#include <random>

#include "palpate/contact/model.h"

namespace palpate {
namespace {

Vector<Patient> random_vector(std::mt19937& random) {
  std::normal_distribution<double> normal(0, 30);
  return {normal(random), normal(random), normal(random)};
}

TEST(Viscosity, DissipatesAndFadesTowardsTheSurface) {
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

}  // namespace
}  // namespace palpate
