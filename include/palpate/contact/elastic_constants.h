#pragma once

/// Elastic constants of soft tissue, as given in a scene and used by the solvers.
namespace palpate {

/// Closed range of Young's modulus.
struct ElasticModulusRange {
  double min_kPa, max_kPa;
};
inline constexpr ElasticModulusRange kElasticModulusRange{0.1, 100'000};
/// Upper limit of Poisson's ratio: nearer to 0.5 a body is nearly incompressible, and solving takes ever
/// longer.
inline constexpr double kMaxPoissonsRatio = 0.495;

/// Upper limit of ElasticConstants::stiffening: stress grows e-fold by 6 % of uniaxial strain.
inline constexpr double kMaxStiffening = 100;

/// Constants of an isotropic elastic body.
struct ElasticConstants {
  double youngs_modulus_kPa = 10;  ///< Young's modulus, in kElasticModulusRange
  double poissons_ratio = 0.45;    ///< Poisson's ratio, 0 ... kMaxPoissonsRatio
  /// Exponent b of Fung's law under TissueLaw::kExponential: strain energy mu / 2 b (exp(2 b U / mu) - 1),
  /// U that of the neo-Hookean body; for incompressible tissue mu / 2 b (exp(b (I1 - 3)) - 1) (Demiray 1972,
  /// J Biomech 5:309). 0 ... kMaxStiffening. 0: neo-Hookean.
  double stiffening = 0;
  bool operator==(const ElasticConstants&) const = default;
};

}  // namespace palpate
