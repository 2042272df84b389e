#include <gtest/gtest.h>

#include <cmath>

#include "indentation/test_curves.h"
#include "palpate/contact/soft_contact.h"

namespace palpate {
namespace {

using testing::curve_of;
using testing::solved_curves;

TEST(IndentationModel, IsWithinFivePercentOfFiniteElementsUpToItsLimit) {
  for (const auto& solved : solved_curves()) {
    const IndentationCurve curve = curve_of(solved, 3, 20);
    const ElasticConstants tissue{20, solved.poissons_ratio, solved.stiffening};
    int compared = 0;
    for (std::size_t n = 0; n < curve.depth_mm.size(); ++n) {
      if (curve.depth_mm[n] > indentation_limit_mm(curve.setup)) continue;
      ++compared;
      const double force_N =
          indentation_force_N(tissue, TissueLaw::kExponential, curve.setup, curve.depth_mm[n]);
      EXPECT_NEAR(force_N / curve.force_N[n], 1, 0.05)
          << "b " << solved.stiffening << ", " << solved.thicknesses_in_radii << " R thick, nu "
          << solved.poissons_ratio << ", depth " << curve.depth_mm[n];
    }
    EXPECT_GE(compared, 30);
  }
}

// the tick's law is that of a sphere, which a paraboloid approximates at small depths
TEST(IndentationModel, IsHertzOnAHalfSpaceAndTheContactLawOfTheTick) {
  const IndentationSetup setup{4, 0, SpecimenBase::kThick};
  const ElasticConstants tissue{10, 0.45};
  const double modulus = contact_modulus_N_per_mm2(tissue);
  EXPECT_NEAR(indentation_force_N(tissue, TissueLaw::kElastic, setup, 0.02) /
                  soft_contact_force({0, {}, modulus}, 0.02, 4).force_N,
              1, 1e-3);
  EXPECT_EQ(indentation_force_N(tissue, TissueLaw::kElastic, setup, -1), 0);
  // the tick's law leaves out that a neo-Hookean body is up to 4 % softer
  ContactLaw stiff{0, {}, modulus};
  stiff.strain_stiffening = 15;
  EXPECT_NEAR(indentation_force_N({10, 0.45, 15}, TissueLaw::kExponential, setup, 1.5) /
                  soft_contact_force(stiff, 1.5, 4).force_N,
              1, 0.05);
}

TEST(IndentationModel, ALayerIsDimitriadisForSmallStrains) {
  // bonded and incompressible: 1 + 1.133 chi + 1.283 chi^2 + 0.769 chi^3 + 0.0975 chi^4
  const IndentationSetup bonded{4, 10, SpecimenBase::kBonded}, sliding{4, 10, SpecimenBase::kSliding},
      thick{4, 0, SpecimenBase::kThick};
  const double depth_mm = 0.5, chi = std::sqrt(4 * depth_mm) / 10;
  const ElasticConstants tissue{10, 0.495};
  const double half_space_N = indentation_force_N(tissue, TissueLaw::kElastic, thick, depth_mm);
  EXPECT_NEAR(indentation_force_N(tissue, TissueLaw::kElastic, bonded, depth_mm) / half_space_N,
              1 + 1.133 * chi + 1.283 * chi * chi + 0.769 * std::pow(chi, 3) + 0.0975 * std::pow(chi, 4),
              0.01);
  // sliding: 1 + 0.884 chi + 0.781 chi^2 + 0.386 chi^3 + 0.0048 chi^4
  EXPECT_NEAR(indentation_force_N(tissue, TissueLaw::kElastic, sliding, depth_mm) / half_space_N,
              1 + 0.884 * chi + 0.781 * chi * chi + 0.386 * std::pow(chi, 3) + 0.0048 * std::pow(chi, 4),
              0.01);
}

TEST(IndentationModel, ComparesACurveWithThePresetThatItNames) {
  IndentationCurve curve;
  curve.setup = {4, 0, SpecimenBase::kThick};
  curve.preset = "fat";  // 9.1 kPa, 1 ... 25
  for (int n = 1; n <= 20; ++n) {
    curve.depth_mm.push_back(0.1 * n);
    // the first half inside the band, then above it
    const double kPa = n <= 10 ? 18.2 : 30;
    curve.force_N.push_back(
        indentation_force_N({kPa, 0.45}, TissueLaw::kExponential, curve.setup, curve.depth_mm.back()));
  }
  const auto compared = compare_with_preset(curve);
  ASSERT_TRUE(compared.ok());
  EXPECT_EQ(compared->inside_fraction, 0.5);
  EXPECT_NEAR(compared->end_force_ratio, 30 / 9.1, 1e-9);
  curve.preset = "bone";
  EXPECT_FALSE(compare_with_preset(curve).ok());
  curve.preset = "jelly";
  EXPECT_FALSE(compare_with_preset(curve).ok());
}

}  // namespace
}  // namespace palpate
