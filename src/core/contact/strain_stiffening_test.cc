#include "palpate/contact/strain_stiffening.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "palpate/contact/soft_contact.h"

namespace palpate {
namespace {

constexpr double kHalfSpaceModulus = 0.0125;  // E = 10 kPa, nu = 0.45

ContactLaw stiffening_half_space(double b) {
  ContactLaw tissue{0, {}, kHalfSpaceModulus};
  tissue.strain_stiffening = b;
  return tissue;
}

// Force over that of Hertz at a depth over the radius, from finite elements of its own: axisymmetric, nine
// nodes, a true sphere, thickness 12 R, nu 0.45, Fung's law (tools/indentation_fe).
TEST(StrainStiffening, MatchesFiniteElementsOnAHalfSpace) {
  struct Case {
    double b, relative_depth, over_hertz;
  };
  for (const auto& [b, relative_depth, over_hertz] :
       {Case{3, 0.1, 1.0361}, Case{3, 0.4, 1.1304}, Case{3, 0.7, 1.2229}, Case{10, 0.1, 1.1126},
        Case{10, 0.3, 1.3020}, Case{10, 0.6, 1.5747}, Case{10, 0.8, 1.7596}, Case{30, 0.1, 1.2866},
        Case{30, 0.3, 1.7374}, Case{30, 0.6, 2.3884}}) {
    constexpr double kRadius_mm = 4;
    const double depth_mm = relative_depth * kRadius_mm;
    const double hertz_N = 4.0 / 3 * kHalfSpaceModulus * std::sqrt(kRadius_mm) * std::pow(depth_mm, 1.5);
    const double force_N = soft_contact_force(stiffening_half_space(b), depth_mm, kRadius_mm).force_N;
    EXPECT_NEAR(force_N / hertz_N / over_hertz, 1, 0.05) << b << " " << relative_depth;
  }
}

TEST(StrainStiffening, ZeroStiffeningIsBitIdenticalToTheBaseLaw) {
  ContactLaw tissue{3, {-0.8, 0.3, 0}, kHalfSpaceModulus};
  tissue.stiffening_mm_per_N2 = 12;
  tissue.reference_force_N = 0.02;
  const SoftContactForce without = soft_contact_force(tissue, 2, 3, 1);
  tissue.strain_stiffening = 0;
  EXPECT_EQ(without.force_N, soft_contact_force(tissue, 2, 3, 1).force_N);
  const StiffenedContact none = stiffened_contact(0, 0.3, kHalfSpaceModulus, 3);
  EXPECT_EQ(none.factor, 1);
  EXPECT_EQ(none.stored_mJ, 0.3);
}

ContactLaw random_tissue(std::mt19937& random) {
  std::uniform_real_distribution<double> unit(0, 1);
  ContactLaw tissue{0, {}, std::pow(10, 3 * unit(random) - 3)};
  tissue.surroundings_mm_per_N = (2 * unit(random) - 0.5) / (4 * tissue.modulus_N_per_mm2);
  tissue.strain_stiffening = 100 * unit(random);
  return tissue;
}

TEST(StrainStiffening, ForceIsTheEnergyGradientWithinTheStiffnessLimit) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int n = 0; n < 3000; ++n) {
    const ContactLaw tissue = random_tissue(random);
    const double radius_mm = 0.5 + 7 * unit(random), depth_mm = std::pow(10, 2.5 * unit(random) - 1.5);
    const double largest = n % 2 == 0 ? std::pow(10, 3 * unit(random) - 2) : 1e9;
    const double step_mm = 1e-4 * depth_mm;
    const SoftContactForce less = soft_contact_force(tissue, depth_mm - step_mm, radius_mm, largest),
                           at = soft_contact_force(tissue, depth_mm, radius_mm, largest),
                           more = soft_contact_force(tissue, depth_mm + step_mm, radius_mm, largest);
    const double work_N = (more.stored_mJ - less.stored_mJ) / (2 * step_mm);
    ASSERT_GT(work_N, less.force_N * (1 - 1e-4)) << n;
    ASSERT_LT(work_N, more.force_N * (1 + 1e-4)) << n;
    const auto [least, greatest] =
        std::minmax({less.tangent_N_per_mm, at.tangent_N_per_mm, more.tangent_N_per_mm});
    const double slope = (more.force_N - less.force_N) / (2 * step_mm);
    ASSERT_GT(slope, least * (1 - 2e-3)) << n;
    ASSERT_LT(slope, greatest * (1 + 2e-3)) << n;
    ASSERT_LE(at.tangent_N_per_mm, largest * (1 + 1e-9)) << n;
    // relaxation needs the energy, and the coefficients of the force aside, at a force
    ASSERT_NEAR(
        complementary_mJ(tissue, at.force_N, radius_mm, largest) / (at.force_N * depth_mm - at.stored_mJ), 1,
        1e-6)
        << n;
  }
}

TEST(StrainStiffening, TangentialForceIsTheEnergyGradient) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int n = 0; n < 300; ++n) {
    ContactLaw tissue = random_tissue(random);
    tissue.gradient_per_N = {0.1 / tissue.modulus_N_per_mm2, 0, 0};
    // in every other case beyond the limit of stiffness
    const double largest = n % 2 == 0 ? 1e9 : 0.5 * soft_contact_force(tissue, 1, 3).tangent_N_per_mm;
    const auto stored_mJ = [&](double distance_mm) {
      ContactLaw there = tissue;
      there.surroundings_mm_per_N += distance_mm * tissue.gradient_per_N[0];
      return soft_contact_force(there, 1, 3, largest).stored_mJ;
    };
    constexpr double kDistance_mm = 1e-4;
    const double lost_N = (stored_mJ(-kDistance_mm) - stored_mJ(kDistance_mm)) / (2 * kDistance_mm);
    const SoftContactForce at = soft_contact_force(tissue, 1, 3, largest);
    ASSERT_NEAR(at.tangential_force_N[0] / lost_N, 1, 1e-4) << n;
    ASSERT_NEAR(tangential_coefficients(tissue, at.force_N, 3, largest).of_compliance_N2 *
                    tissue.gradient_per_N[0] / lost_N,
                1, 1e-4)
        << n;
  }
}

TEST(StrainStiffening, ClosedPathOverVaryingTissueDoesNoWork) {
  // down, aside to where the surroundings are twice as soft, up and back above the surface
  ContactLaw tissue = stiffening_half_space(20);
  tissue.gradient_per_N = {0.3 / kHalfSpaceModulus / 4, 0, 0};
  const auto at = [&](double x_mm, double depth_mm) {
    ContactLaw there = tissue;
    there.surroundings_mm_per_N += x_mm * tissue.gradient_per_N[0];
    return soft_contact_force(there, depth_mm, 3);
  };
  constexpr int kSteps = 2000;
  double work = 0, gross = 0;
  for (int n = 0; n < kSteps; ++n) {
    const double s = (n + 0.5) / kSteps;
    const double in = at(0, 2 * s).force_N * 2 / kSteps, out = at(4, 2 * s).force_N * 2 / kSteps;
    const double lateral = -at(4 * s, 2).tangential_force_N[0] * 4 / kSteps;
    work += in + lateral - out;
    gross += in + std::abs(lateral) + out;
  }
  EXPECT_LE(std::abs(work), 1e-5 * gross);
}

TEST(StrainStiffening, FramesBlendWithoutAForceStep) {
  LocalCompliance local;
  local.compliance_mm_per_N = 20;
  local.modulus_N_per_mm2 = kHalfSpaceModulus;
  local.patch_radius_mm = 3;
  local.strain_stiffening = 5;
  ComplianceState state;
  const auto force_N = [&](std::uint32_t frame) {
    return soft_contact_force(blend_compliance(frame, local, {}, kHalfSpaceModulus, 0.001, state), 2, 3)
        .force_N;
  };
  double before_N = force_N(1);
  local.strain_stiffening = 50;
  for (int n = 0; n < 16; ++n) {
    const double now_N = force_N(2);
    EXPECT_GT(now_N, before_N);
    EXPECT_LT(now_N - before_N, 0.15 * before_N);
    before_N = now_N;
  }
  ComplianceState fresh;
  EXPECT_NEAR(
      before_N,
      soft_contact_force(blend_compliance(2, local, {}, kHalfSpaceModulus, 0.001, fresh), 2, 3).force_N,
      1e-12);
  // without a frame: that of the tissue itself
  ComplianceState unknown;
  EXPECT_EQ(blend_compliance(0, {}, {}, kHalfSpaceModulus, 0.001, unknown, 7).strain_stiffening, 7);
  ComplianceFrame a, b;
  a.local_compliance[0] = b.local_compliance[0] = local;
  b.local_compliance[0].strain_stiffening = 49;
  EXPECT_NE(a.hash(), b.hash());
}

}  // namespace
}  // namespace palpate
