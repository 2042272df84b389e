#pragma once

/// What soft tissue is made of, as an elastic body: what a scene says of it, and what solvers take.
namespace palpate {

/// Both ends belong to it.
struct ElasticModulusRange {
  double min_kPa, max_kPa;
};
inline constexpr ElasticModulusRange kElasticModulusRange{0.1, 100'000};
/// Above that a body hardly changes its volume, and solving takes ever longer.
inline constexpr double kMostPoissonsRatio = 0.495;

/// Of a body that is the same in all directions.
struct ElasticConstants {
  double youngs_modulus_kPa = 10;  ///< in kElasticModulusRange
  double poissons_ratio = 0.45;    ///< 0 ... kMostPoissonsRatio
  bool operator==(const ElasticConstants&) const = default;
};

}  // namespace palpate
