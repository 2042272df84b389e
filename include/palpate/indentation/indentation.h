#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/contact/elastic_constants.h"
#include "palpate/contact/model.h"
#include "palpate/contact/relaxation.h"

/// Measured indentation curves, the tissue that explains them, and the comparison of a tissue with them.
/// docs/guide/fit.md describes the file and the model.
namespace palpate {

/// Support of an indented specimen.
enum class SpecimenBase {
  kThick,    ///< Nothing that matters: the specimen is a half-space
  kBonded,   ///< A rigid plate to which it adheres
  kSliding,  ///< A rigid plate on which it slides without friction
};

/// Indenter and specimen.
struct IndentationSetup {
  double radius_mm = 0;     ///< Radius of the sphere; above 0
  double thickness_mm = 0;  ///< Thickness of the specimen; above 0 unless it is thick
  SpecimenBase base = SpecimenBase::kThick;
};

/// A measured curve: samples in the order in which they were taken.
struct IndentationCurve {
  std::string name;
  std::string preset;  ///< Preset to compare it with; empty: none
  IndentationSetup setup;
  std::vector<double> depth_mm, force_N;
  std::vector<double> time_s;  ///< Ascending; empty: not recorded
};

/// Values for columns that a file does not have.
struct CurveDefaults {
  std::optional<double> radius_mm, thickness_mm;
  std::optional<SpecimenBase> base;
  std::string preset;
};

/// Maximum size of a file of curves, and maximum number of its curves and samples.
inline constexpr std::size_t kMaxCurveBytes = 64u << 20, kMaxCurves = 2000, kMaxCurveSamples = 500'000;

/// Reads a table with commas and the columns depth_mm and force_N, and optionally time_s, curve, radius_mm,
/// thickness_mm, base (thick, bonded, sliding) and preset, which are constant within a curve. Lines that
/// begin with # are comments. A curve is a sequence of lines with the same text in `curve`.
/// @param source  name of the text in errors ("curves.csv:12")
/// Errors: kBadInput with the line.
Result<std::vector<IndentationCurve>> read_indentation_curves(std::string_view text,
                                                              const CurveDefaults& defaults,
                                                              const std::string& source);

/// Force of a rigid frictionless sphere on a homogeneous specimen without relaxation, N.
///
/// A half-space by Hertz, a layer by Dimitriadis et al. 2002 (Biophys J 82:2798). For finite strains these
/// are corrected by, and stiffening follows, axisymmetric finite element solutions with a Poisson's ratio of
/// 0.45 (docs/guide/fit.md), within 5 % up to indentation_limit_mm().
/// @param law  TissueLaw::kElastic, kNeoHookean or kExponential
double indentation_force_N(const ElasticConstants& constants, TissueLaw law, const IndentationSetup& setup,
                           double depth_mm);
/// Depth up to which the model is valid: 0.7 radii, and 0.2 of the thickness of a layer; mm.
double indentation_limit_mm(const IndentationSetup& setup);

/// Estimated value with the interval of two standard errors.
struct FittedValue {
  double value = 0, low = 0, high = 0;
};

/// Fit of one law.
struct LawFit {
  TissueLaw law = TissueLaw::kElastic;
  FittedValue youngs_modulus_kPa, stiffening;
  std::vector<std::array<FittedValue, 2>> relaxation;  ///< Fraction and time constant, s, of each term
  std::vector<double> contact_mm;                      ///< Depth at which contact begins, by curve
  /// Root mean square of the residuals over the greatest force of their curve, percent.
  double rms_percent = 0;
  std::string undetermined;  ///< Why the data do not determine the law. Empty: they do

  ElasticConstants constants(double poissons_ratio) const;
};

/// Tissue that explains curves.
struct TissueFit {
  std::vector<LawFit> laws;  ///< One per law
  std::size_t chosen = 0;    ///< The simplest determined law that no other one improves significantly
  double poissons_ratio = 0;
  std::size_t samples = 0, left_out = 0;  ///< Used samples, and those beyond indentation_limit_mm()
  std::vector<std::string> notes;         ///< Limitations, one sentence each

  const LawFit& best() const { return laws[chosen]; }
};

/// Options of a fit.
struct FitOptions {
  double poissons_ratio = 0.45;  ///< Not determined by indentation; 0.3 ... kMaxPoissonsRatio
  bool find_contact = false;     ///< The depth at which contact begins is unknown: fitted for each curve
  bool relaxes = true;           ///< Look for relaxation where a curve has times and holds its depth
  std::optional<TissueLaw> law;  ///< The only law to fit; empty: the simplest that explains the data
};

/// Fits one tissue to all curves by weighted nonlinear least squares (Levenberg-Marquardt).
/// Errors: kBadInput if the data determine no law, or not the law asked for, with the reason and the remedy.
Result<TissueFit> fit_tissue(std::span<const IndentationCurve> curves, const FitOptions& options = {});

/// Forces of a fitted law at the samples of a curve, N; NaN where the model is not valid.
/// @param index  index of the curve in the fit
std::vector<double> fitted_forces_N(const LawFit& fit, double poissons_ratio, const IndentationCurve& curve,
                                    std::size_t index);

/// The chosen law as keys of a [[tissue]] of a scene, followed by its [yielding].
std::string tissue_toml(const TissueFit& fit);
/// Table of the laws: values, intervals and residuals.
std::string fit_table(const TissueFit& fit);
/// Picture of the measured samples and of the fitted laws (SVG).
std::string fit_svg(std::span<const IndentationCurve> curves, const TissueFit& fit);

/// A measured curve compared with a preset.
struct PresetComparison {
  /// Fraction of the samples, from first contact on, inside the band that the preset's range of Young's
  /// modulus spans.
  double inside_fraction = 0;
  double end_force_ratio = 0;  ///< Force at the deepest valid sample over the preset's at that depth
};
/// Compares a curve with the preset that it names, under TissueLaw::kExponential. Errors: kBadInput for an
/// unknown or a rigid preset, and for a curve without a valid sample.
Result<PresetComparison> compare_with_preset(const IndentationCurve& curve);

}  // namespace palpate
