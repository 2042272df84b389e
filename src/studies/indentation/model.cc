#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "palpate/contact/soft_contact.h"
#include "palpate/indentation/indentation.h"

namespace palpate {
namespace {

/// Fractions by which the force of a finite, neo-Hookean body falls below the linear one, per depth over the
/// radius and per depth over the thickness. These constants and the following are those of axisymmetric
/// finite elements (docs/guide/fit.md).
constexpr double kSofterPerRadius = 0.06, kSofterPerThickness = 0.26;
/// Factor of the half-space's stiffening (docs/guide/fit.md), its increase per depth over the radius, and the
/// stiffening at which half of that is left.
constexpr double kStiffening = 0.12, kSteeperPerRadius = 0.36, kSteeperUntil = 45;
/// Exponent of a layer's further stiffening: this times b sqrt(R / h) (d / h)^2.
constexpr double kLayerStiffening = 1.8, kMaxLayerExponent = 20;

/// Factor of Hertz's force: 1 + sum of c_n chi^n, chi = sqrt(R d) / h.
std::array<double, 5> layer_series(SpecimenBase base, double nu) {
  if (base == SpecimenBase::kThick) return {1, 0, 0, 0, 0};
  const bool bonded = base == SpecimenBase::kBonded;
  const double a =
      bonded ? -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1 - nu) : -0.347 * (3 - 2 * nu) / (1 - nu);
  const double b =
      bonded ? (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1 - nu) : 0.056 * (5 - 2 * nu) / (1 - nu);
  const double pi = std::numbers::pi, pi2 = pi * pi;
  return {1, -2 * a / pi, 4 * a * a / pi2, -8 / (pi2 * pi) * (a * a * a + 4 * pi2 / 15 * b),
          16 * a / (pi2 * pi2) * (a * a * a + 3 * pi2 / 5 * b)};
}

}  // namespace

double indentation_limit_mm(const IndentationSetup& setup) {
  constexpr double kRadii = 0.7, kThicknesses = 0.2;
  const double by_radius = kRadii * setup.radius_mm;
  return setup.base == SpecimenBase::kThick ? by_radius
                                            : std::min(by_radius, kThicknesses * setup.thickness_mm);
}

double indentation_force_N(const ElasticConstants& constants, TissueLaw law, const IndentationSetup& setup,
                           double depth_mm) {
  if (!(depth_mm > 0)) return 0;
  const double modulus = contact_modulus_N_per_mm2(constants), radius = setup.radius_mm;
  const double hertz_N = 4.0 / 3 * modulus * std::sqrt(radius * depth_mm) * depth_mm;
  const bool thick = setup.base == SpecimenBase::kThick;
  const double by_thickness = thick ? 0 : depth_mm / setup.thickness_mm;
  const double chi = thick ? 0 : std::sqrt(radius * depth_mm) / setup.thickness_mm;
  const double softer = law == TissueLaw::kElastic
                            ? 0
                            : kSofterPerRadius * depth_mm / radius + kSofterPerThickness * by_thickness;
  // force, and its integral over the depth: terms with d^(3/2 + n/2), and with one power more
  double force_N = 0, stored_mJ = 0, power = 1;
  const auto series = layer_series(setup.base, constants.poissons_ratio);
  for (std::size_t n = 0; n < series.size(); ++n, power *= chi) {
    const double order = 2.5 + 0.5 * static_cast<double>(n), term = series[n] * power * hertz_N;
    force_N += term * (1 - softer);
    stored_mJ += term * depth_mm * (1 / order - softer / (order + 1));
  }
  if (law != TissueLaw::kExponential) return force_N;
  const double b = constants.stiffening;
  const double layer =
      thick ? 0 : kLayerStiffening * b * std::sqrt(radius / setup.thickness_mm) * by_thickness * by_thickness;
  const double steeper = 1 + kSteeperPerRadius * depth_mm / radius / (1 + b / kSteeperUntil);
  // stiffening factor, fitted to finite-element forces relative to those computed here; the contact law's
  // factor is fitted relative to the contact law's forces
  const double unit_mJ = (8.0 / 15) * modulus * radius * radius * radius;
  const double more = kStiffening * std::pow(b, 5.0 / 6) * std::cbrt(std::max(stored_mJ, 0.0) / unit_mJ);
  return force_N * std::exp(std::min(layer, kMaxLayerExponent)) * (1 + more * steeper);
}

}  // namespace palpate
