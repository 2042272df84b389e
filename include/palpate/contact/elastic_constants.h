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

/// Constants of an isotropic elastic body.
struct ElasticConstants {
  double youngs_modulus_kPa = 10;  ///< Young's modulus, in kElasticModulusRange
  double poissons_ratio = 0.45;    ///< Poisson's ratio, 0 ... kMaxPoissonsRatio
  bool operator==(const ElasticConstants&) const = default;
};

}  // namespace palpate
