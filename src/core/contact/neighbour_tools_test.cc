#include "palpate/contact/neighbour_tools.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "base/test_seed.h"
#include "palpate/contact/soft_contact.h"

namespace palpate {
namespace {

constexpr double kSoftModulus = 0.0125, kPressRadius_mm = 4;

TissueContact press_at(const Point<Patient>& at, double force_N, double modulus = kSoftModulus) {
  TissueContact press;
  press.force_N = force_N;
  press.tangent_N_per_mm = 1e-3;
  press.modulus_N_per_mm2 = modulus;
  press.radius_mm = kPressRadius_mm;
  press.at = at;
  press.outward = Vector<Patient>(0, 0, 1);
  press.surface = 3;
  return press;
}

NeighbourEffect effect_on_first(const std::array<TissueContact, 2>& presses) {
  return neighbour_effect(presses, 0, presses[0]);
}

TEST(NeighbourTools, HalfSpaceDisplacementMatchesBoussinesq) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int n = 0; n < 200; ++n) {
    const Vector<Patient> lateral(4 * kPressRadius_mm * unit(random), 4 * kPressRadius_mm * unit(random), 0);
    if (lateral.norm() < kPressRadius_mm) continue;
    std::array presses{press_at({1, 2, 0}, 0.1), press_at(Point<Patient>(1, 2, 0) + lateral, 0.3)};
    const NeighbourEffect effect = effect_on_first(presses);
    EXPECT_NEAR(effect.displaced_mm, 0.3 / (std::numbers::pi * kSoftModulus * lateral.norm()), 1e-12);
    EXPECT_GT(effect.force_per_N.dot(lateral), 0) << "towards the dent of the other tool";
  }
}

TEST(NeighbourTools, TangentialForceIsTheGradientOfASymmetricCompliance) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int n = 0; n < 200; ++n) {
    const Point<Patient> at(20 * unit(random), 20 * unit(random), 0);
    std::array presses{press_at(at, 0.1, kSoftModulus * (1 + unit(random))), press_at({10, 10, 0}, 0.2)};
    for (TissueContact& press : presses) press.base_per_mm = 0.1 * unit(random);
    const NeighbourEffect effect = effect_on_first(presses);
    const NeighbourEffect back = neighbour_effect(presses, 1, presses[1]);
    EXPECT_NEAR(effect.displaced_mm / presses[1].force_N, back.displaced_mm / presses[0].force_N, 1e-12);
    constexpr double kStep_mm = 1e-5;
    for (const Vector<Patient>& axis : {Vector<Patient>(1, 0, 0), Vector<Patient>(0, 1, 0)}) {
      std::array ahead = presses, behind = presses;
      ahead[0].at += axis * kStep_mm;
      behind[0].at += axis * -kStep_mm;
      const double slope =
          (effect_on_first(ahead).displaced_mm - effect_on_first(behind).displaced_mm) / (2 * kStep_mm);
      EXPECT_NEAR(effect.force_per_N.dot(axis), slope, 1e-4 * (0.01 + std::abs(slope))) << at.eigen();
    }
  }
}

TEST(NeighbourTools, OnlyToolsOnTheSameSideOfTheSameTissueInteract) {
  const std::array together{press_at({0, 0, 0}, 0.1), press_at({8, 0, 0}, 0.2)};
  EXPECT_GT(effect_on_first(together).displaced_mm, 0);
  std::array changed = together;
  changed[1].surface = 4;
  EXPECT_EQ(effect_on_first(changed).displaced_mm, 0);
  changed = together;
  changed[1].outward = Vector<Patient>(0, 0, -1);
  EXPECT_EQ(effect_on_first(changed).displaced_mm, 0);
  changed = together;
  changed[1].force_N = 0;
  EXPECT_EQ(effect_on_first(changed).displaced_mm, 0);
  // farther apart than a layer is thick
  changed = together;
  for (TissueContact& press : changed) press.base_per_mm = 0.55 / 5;
  EXPECT_EQ(effect_on_first(changed).displaced_mm, 0);
}

TEST(NeighbourTools, CommonStiffnessStaysPositiveDefinite) {
  std::array presses{press_at({0, 0, 0}, 0.1), press_at({kPressRadius_mm, 0, 0}, 0.2)};
  presses[0].tangent_N_per_mm = 2;
  presses[1].tangent_N_per_mm = 0.5;
  const NeighbourEffect effect = effect_on_first(presses);
  EXPECT_LT(effect.displaced_mm / presses[1].force_N, 1 / std::sqrt(2 * 0.5));
  EXPECT_EQ(effect.force_per_N, Vector<Patient>()) << "the limited compliance does not depend on the place";
}

}  // namespace
}  // namespace palpate
