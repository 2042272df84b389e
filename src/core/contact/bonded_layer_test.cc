#include "palpate/contact/bonded_layer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "contact/test_layer_oracle.h"
#include "palpate/contact/soft_contact.h"

namespace palpate {
namespace {

using testing::LayerOracle;

constexpr double kRatios[] = {0.3, 0.45, 0.49};

// a layer of thickness t in which a sphere of radius R feels the exact B
ContactLaw layer_of(double thickness_mm, double modulus, double poissons_ratio) {
  ContactLaw layer{layer_base_mm_per_N(thickness_mm, modulus, poissons_ratio), {}, modulus};
  layer.poissons_ratio = poissons_ratio;
  return layer;
}

TEST(LayerOracle, MatchesSneddonOnAThickLayerAndTheFoundationOnAThinOne) {
  const LayerOracle oracle(0.3);
  const auto small = oracle.contact(0.02, 0.01);
  EXPECT_NEAR(small.depth / (0.01 * std::atanh(0.5)), 1, 0.02);
  // a layer much thinner than the contact is a bed of springs of the confined modulus
  const auto wide = oracle.contact(1e4, 12);
  const double confined = 0.49 / 0.4;  // (1 - nu)^2 / (1 - 2 nu) E*
  EXPECT_NEAR(wide.force / (std::numbers::pi * confined * 1e4 * wide.depth * wide.depth), 1, 0.12);
}

TEST(BondedLayer, SphereForceMatchesTheExactSolutionToHalfTheThickness) {
  for (const double poissons_ratio : kRatios) {
    const LayerOracle oracle(poissons_ratio);
    for (const double thickness_mm : {2.0, 3.0, 5.0, 10.0, 20.0})
      for (const double radius_mm : {1.5, 3.0, 8.0, 12.0})
        for (const double part : {0.02, 0.1, 0.3, 0.4, 0.5}) {
          // the law is proportional to the modulus
          const double modulus = 0.01;
          const auto exact = oracle.at_depth(radius_mm / thickness_mm, part);
          const double exact_N = exact.force * modulus * thickness_mm * thickness_mm;
          const double force_N = soft_contact_force(layer_of(thickness_mm, modulus, poissons_ratio),
                                                    part * thickness_mm, radius_mm)
                                     .force_N;
          EXPECT_NEAR(force_N / exact_N, 1, part <= 0.3 ? 0.04 : 0.06)
              << "nu " << poissons_ratio << ", " << thickness_mm << " mm, R " << radius_mm << ", " << part;
        }
  }
}

TEST(BondedLayer, ForceIncreasesWithoutFoldAtEveryDepthAndThickness) {
  for (const double poissons_ratio : {0.0, 0.3, 0.45, 0.495})
    for (const double thickness_mm : {0.05, 0.3, 2.0, 5.0, 20.0})
      for (const double radius_mm : {0.5, 3.0, 12.0}) {
        double before_N = 0, slope_before = 0;
        for (int n = 1; n <= 400; ++n) {
          const SoftContactForce force = soft_contact_force(layer_of(thickness_mm, 0.01, poissons_ratio),
                                                            n * thickness_mm / 200, radius_mm);
          ASSERT_GT(force.force_N, before_N) << poissons_ratio << ", " << thickness_mm << ", " << radius_mm;
          // stiffens with depth, except for the fit's error where the contact reaches the equator
          ASSERT_GT(force.tangent_N_per_mm, 0.995 * slope_before);
          before_N = force.force_N;
          slope_before = force.tangent_N_per_mm;
        }
      }
}

TEST(BondedLayer, SurroundingsAreRecoveredFromAPatchOfAnyRadius) {
  for (const double poissons_ratio : kRatios) {
    const LayerOracle oracle(poissons_ratio);
    EXPECT_NEAR(-layer_base_mm_per_N(1, 1, poissons_ratio) / oracle.base(), 1, 0.002);
    for (const double rho : {0.1, 0.3, 1.0, 2.0, 4.0}) {
      const double w = oracle.patch(rho) * 0.6 / rho;
      const auto found = surroundings_of_patch(w, rho, 1, poissons_ratio);
      EXPECT_NEAR(found.surroundings_mm_per_N / -oracle.base(), 1, 0.02) << poissons_ratio << ", " << rho;
      EXPECT_NEAR(patch_compliance_mm_per_N(found.surroundings_mm_per_N, rho, 1, poissons_ratio) / w, 1,
                  1e-9);
      const double step = 1e-5 * w;
      const double change = (surroundings_of_patch(w + step, rho, 1, poissons_ratio).surroundings_mm_per_N -
                             surroundings_of_patch(w - step, rho, 1, poissons_ratio).surroundings_mm_per_N) /
                            (2 * step);
      EXPECT_NEAR(found.per_compliance / change, 1, 1e-4);
    }
  }
}

TEST(BondedLayer, SoftAndStiffSurroundingsBlendWithoutAStep) {
  const double half_space = 0.6 / 3;
  for (const double more : {-1e-6, 1e-6}) {
    const auto found = surroundings_of_patch(half_space + more, 3, 1, 0.45);
    EXPECT_NEAR(found.surroundings_mm_per_N, more, 1e-10);
    EXPECT_NEAR(found.per_compliance, 1, 1e-4);
  }
  const auto force_at = [](double surroundings) {
    ContactLaw tissue{surroundings, {1, 0, 0}, 1};
    return soft_contact_force(tissue, 1, 3);
  };
  EXPECT_NEAR(force_at(-1e-7).force_N, force_at(1e-7).force_N, 1e-5);
  EXPECT_NEAR(force_at(-1e-7).tangential_force_N.x(), force_at(1e-7).tangential_force_N.x(), 1e-5);
}

TEST(BondedLayer, TangentialForceIsTheGradientOfTheEnergy) {
  constexpr double kStep = 1e-4;
  for (const double surroundings : {-5.0, -40.0, -400.0})
    for (const double max_N_per_mm : {1e9, 0.2}) {
      const auto at = [&](double x) {
        ContactLaw tissue{surroundings * (1 + 0.1 * x), {0.1 * surroundings, 0, 0}, 0.0125};
        return soft_contact_force(tissue, 1.2, 3, max_N_per_mm);
      };
      const double lost = (at(-kStep).stored_mJ - at(kStep).stored_mJ) / (2 * kStep);
      EXPECT_NEAR(at(0).tangential_force_N.x() / lost, 1, 1e-3) << surroundings << ", " << max_N_per_mm;
    }
}

}  // namespace
}  // namespace palpate
