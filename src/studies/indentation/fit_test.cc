#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "indentation/test_curves.h"
#include "palpate/scene/scene.h"

namespace palpate {
namespace {

using testing::curve_of;
using testing::Planted;
using testing::planted_curve;
using testing::solved_curves;

TissueFit fitted(std::span<const IndentationCurve> curves, const FitOptions& options = {}) {
  auto fit = fit_tissue(curves, options);
  EXPECT_TRUE(fit.ok()) << fit.error().what;
  return fit.ok() ? *std::move(fit) : TissueFit{{LawFit{}}, 0, 0.45, 0, 0, {}};
}

TEST(FitTissue, RecoversParametersWithinFivePercentUnderTwoPercentNoise) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int n = 0; n < 8; ++n) {
    Planted planted;
    planted.constants = {std::pow(10, 0.7 + 1.5 * unit(random)), 0.45, 0};
    const TissueLaw law = n % 2 == 0 ? TissueLaw::kExponential : TissueLaw::kNeoHookean;
    planted.law = law;
    if (law == TissueLaw::kExponential) planted.constants.stiffening = 10 + 40 * unit(random);
    if (n % 4 >= 2) planted.setup = {4, 20, SpecimenBase::kBonded};
    // three repeats, as a laboratory makes them
    const std::vector<IndentationCurve> curves{planted_curve(planted, random), planted_curve(planted, random),
                                               planted_curve(planted, random)};
    const TissueFit fit = fitted(curves);
    EXPECT_EQ(fit.best().law == TissueLaw::kExponential, law == TissueLaw::kExponential) << n;
    EXPECT_NEAR(fit.best().youngs_modulus_kPa.value / planted.constants.youngs_modulus_kPa, 1, 0.05) << n;
    if (law == TissueLaw::kExponential) {
      const FittedValue& b = fit.best().stiffening;
      EXPECT_NEAR(b.value / planted.constants.stiffening, 1, 0.05) << n;
      EXPECT_LT(b.low, b.value);
      EXPECT_GT(b.high, b.value);
    }
    EXPECT_LT(fit.best().rms_percent, 2.5) << n;
    EXPECT_TRUE(fit.best().relaxation.empty()) << "nothing is held";
  }
}

TEST(FitTissue, RecoversRelaxationWhereTheDepthIsHeld) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  Planted planted;
  planted.constants = {12, 0.45, 20};
  planted.relaxation.term[0] = {0.35, 2};
  planted.hold_s = 15;
  const std::vector<IndentationCurve> curves{planted_curve(planted, random), planted_curve(planted, random),
                                             planted_curve(planted, random)};
  const TissueFit fit = fitted(curves);
  ASSERT_EQ(fit.best().relaxation.size(), 1u);
  EXPECT_NEAR(fit.best().relaxation[0][0].value, 0.35, 0.05 * 0.35);
  EXPECT_NEAR(fit.best().relaxation[0][1].value, 2, 0.1 * 2);
  EXPECT_NEAR(fit.best().youngs_modulus_kPa.value, 12, 0.05 * 12);
  EXPECT_NEAR(fit.best().stiffening.value, 20, 0.05 * 20);
  FitOptions without;
  without.relaxes = false;
  EXPECT_GT(fitted(curves, without).best().rms_percent, 2 * fit.best().rms_percent);
}

TEST(FitTissue, ExplainsCurvesOfAnIndependentSolutionWithinTenPercent) {
  for (const auto& solved : solved_curves())
    for (const double kPa : {5.0, 20.0, 60.0, 153.0}) {
      FitOptions options;
      options.poissons_ratio = solved.poissons_ratio;
      if (solved.stiffening > 0) options.law = TissueLaw::kExponential;
      const IndentationCurve curve = curve_of(solved, 4, kPa);
      const TissueFit fit = fitted({&curve, 1}, options);
      const std::string which = std::to_string(kPa) + " kPa, b " + std::to_string(solved.stiffening) + ", " +
                                std::to_string(solved.thicknesses_in_radii) + " R";
      EXPECT_NEAR(fit.best().youngs_modulus_kPa.value / kPa, 1, 0.1) << which;
      if (solved.stiffening > 0) {
        EXPECT_NEAR(fit.best().stiffening.value / solved.stiffening, 1, 0.1) << which;
      }
      EXPECT_LT(fit.best().rms_percent, 3) << which;
      const auto force_N = fitted_forces_N(fit.best(), options.poissons_ratio, curve, 0);
      for (std::size_t n = 5; n < force_N.size(); ++n)
        if (std::isfinite(force_N[n])) {
          EXPECT_NEAR(force_N[n] / curve.force_N[n], 1, 0.1) << which;
        }
    }
}

TEST(FitTissue, FindsWhereContactBegins) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  Planted planted;
  planted.constants = {20, 0.45};
  planted.law = TissueLaw::kElastic;
  planted.noise = 0.01;
  IndentationCurve curve = planted_curve(planted, random);
  for (double& mm : curve.depth_mm) mm += 0.4;
  FitOptions options;
  options.find_contact = true;
  options.law = TissueLaw::kElastic;
  const TissueFit fit = fitted({&curve, 1}, options);
  EXPECT_NEAR(fit.best().contact_mm[0], 0.4, 0.05);
  EXPECT_NEAR(fit.best().youngs_modulus_kPa.value, 20, 1);
}

TEST(FitTissue, RejectsUndeterminedParameters) {
  std::mt19937 random(7);
  const auto refused = [](const IndentationCurve& curve, const char* what, const FitOptions& options = {}) {
    const auto fit = fit_tissue({&curve, 1}, options);
    ASSERT_FALSE(fit.ok()) << what;
    EXPECT_NE(fit.error().what.find(what), std::string::npos) << fit.error().what;
    EXPECT_FALSE(fit.error().remedy.empty());
  };
  Planted planted;
  planted.constants = {12, 0.45, 20};
  const IndentationCurve whole = planted_curve(planted, random);

  IndentationCurve few = whole;
  few.depth_mm.resize(6), few.force_N.resize(6), few.time_s.resize(6);
  refused(few, "5 samples in contact");

  IndentationCurve one_depth = whole;
  for (double& mm : one_depth.depth_mm) mm = 1;
  refused(one_depth, "only 1 distinct depths");

  IndentationCurve noise = whole;
  std::uniform_real_distribution<double> any(0, 0.1);
  for (double& force_N : noise.force_N) force_N = any(random);
  refused(noise, "the data determine no tissue");

  IndentationCurve in_metres = whole;
  for (double& force_N : in_metres.force_N) force_N *= 1e6;
  refused(in_metres, "are depths in mm and forces in N?");

  // a tenth of a radius says nothing of the exponent under noise
  FitOptions exponential;
  exponential.law = TissueLaw::kExponential;
  Planted shallow = planted;
  shallow.to_mm = 0.2;
  shallow.noise = 0.1;
  refused(planted_curve(shallow, random), "stiffening", exponential);

  IndentationCurve deep = whole;
  deep.setup = {4, 0.4, SpecimenBase::kBonded};
  refused(deep, "samples in contact and within 0.08 mm");

  IndentationCurve pulled = whole;
  for (double& force_N : pulled.force_N) force_N = -std::abs(force_N);
  refused(pulled, "no force above 0");
}

TEST(FitTissue, ItsKeysAreTakenByASceneAsTheyStand) {
  std::mt19937 random(3);
  Planted planted;
  planted.constants = {12, 0.45, 20};
  planted.relaxation.term[0] = {0.35, 2};
  planted.hold_s = 15;
  const IndentationCurve curve = planted_curve(planted, random);
  const TissueFit fit = fitted({&curve, 1});
  const std::string scene_text =
      "[data]\nlabels = 'a.nrrd'\n[[tissue]]\nname = 'a'\nlabels = [1]\n" + tissue_toml(fit);
  const auto scene = parse_scene(scene_text, "scene.toml");
  ASSERT_TRUE(scene.ok()) << scene.error().what << "\n" << scene_text;
  const TissueSettings& tissue = scene->tissues[0];
  EXPECT_EQ(scene->deformation.law, TissueLaw::kExponential);
  EXPECT_NEAR(tissue.elastic->youngs_modulus_kPa, fit.best().youngs_modulus_kPa.value, 0.01);
  EXPECT_NEAR(tissue.elastic->stiffening, fit.best().stiffening.value, 0.01);
  EXPECT_NEAR(tissue.relaxation.term[0].fraction, fit.best().relaxation[0][0].value, 1e-3);
  EXPECT_NE(fit_table(fit).find("exponential"), std::string::npos);
  const std::string svg = fit_svg({&curve, 1}, fit);
  EXPECT_EQ(svg.rfind("<svg", 0), 0u);
  EXPECT_NE(svg.find("class=\"best\""), svg.npos);
  EXPECT_EQ(svg.find("nan"), svg.npos);
}

}  // namespace
}  // namespace palpate
