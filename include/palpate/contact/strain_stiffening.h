#pragma once

/// Contact with tissue that stiffens exponentially with strain (TissueLaw::kExponential).
namespace palpate {

/// Stiffening of a sphere's contact at one depth.
///
/// Fung's law multiplies the stress of a neo-Hookean body by a function of its strain energy
/// (ElasticConstants::stiffening). The contact law does the same with the energy E of the contact without
/// stiffening:
///
///     F = g F0,   g = 1 + k b^(3/4) (E / U)^(1/3),   U = 8/15 E* R^3,
///
/// F0 being the force without stiffening, b the exponent of the tissue, R the radius of the sphere, E* the
/// contact modulus and k SoftTissueSettings::stiffening_factor. On a half-space (E / U)^(1/3) is (depth /
/// R)^(5/6). The power and k are those of finite element solutions (docs/concepts/tissue.md): where tissue
/// under the tool stiffens, the load moves to its surroundings, so that the force grows less than
/// exponentially. As g depends on E alone, F is the derivative of an energy, and a closed path does no work
/// wherever it does none without stiffening.
struct StiffenedContact {
  double factor = 1;     ///< g
  double per_mJ = 0;     ///< dg / dE
  double stored_mJ = 0;  ///< Energy with stiffening: integral of g over the energy 0 ... E
};

/// Bit-identical in every build.
/// @param stiffening         b, at least 0
/// @param stored_mJ          E, at least 0
/// @param modulus_N_per_mm2  E*; above 0
/// @param radius_mm          R, of which at least SoftTissueSettings::min_radius_mm is used
StiffenedContact stiffened_contact(double stiffening, double stored_mJ, double modulus_N_per_mm2,
                                   double radius_mm);

}  // namespace palpate
