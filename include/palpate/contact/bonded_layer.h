#pragma once

/// Contact with an elastic layer bonded to a rigid base, without friction. The coefficients were fitted to
/// the exact solution, an integral equation on the Hankel transform of the layer's response (Sneddon 1951;
/// Lebedev and Ufliand 1958, J Appl Math Mech 22:442), which contact/test_layer_oracle.h solves.
namespace palpate {

/// Compliance B of a layer's base, mm/N: in contacts much smaller than the thickness t, a force F indents by
/// B F more than in a half-space of the layer's material. Below 0: -c(nu) / (t E*).
/// @param thickness_mm       t; above 0
/// @param modulus_N_per_mm2  E* = E / (1 - nu^2); above 0
/// @param poissons_ratio     0 ... kMaxPoissonsRatio
double layer_base_mm_per_N(double thickness_mm, double modulus_N_per_mm2, double poissons_ratio);

/// Ratio H of the indentation of a layer to that of a half-space under the same force F.
class LayerFactor {
 public:
  /// Indentation by a sphere.
  static LayerFactor under_sphere(double poissons_ratio);
  /// Mean displacement under the pressure sqrt(1 - r^2 / rho^2), weighted by that pressure.
  static LayerFactor under_patch(double poissons_ratio);

  /// H = 1 / (1 + e + (p e^2 + a e^3) / (1 + q e + b e^2)), and dH/de.
  struct Value {
    double factor, slope;
  };
  /// Decreases from 1 at e = 0, slowly enough for the depth d = d0 H(e) to increase with F at every e. Within
  /// 2.5 % of the exact solution for indentations up to 55 % of the thickness and for patches up to five
  /// thicknesses in radius.
  /// @param e  -B F / d0, d0 the half-space's indentation under F; at least 0
  Value at(double e) const {
    const double over = e * e * (p_ + a_ * e), under = 1 + e * (q_ + b_ * e);
    // one division for both reciprocals
    const double all = under * (1 + e) + over, both = 1 / (under * all);
    const double factor = under * under * both, per_under = all * both;
    const double per_e = (e * (2 * p_ + 3 * a_ * e) - over * per_under * (q_ + 2 * b_ * e)) * per_under;
    return {factor, -(1 + per_e) * factor * factor};
  }

 private:
  LayerFactor(double p, double q, double a, double b) : p_(p), q_(q), a_(a), b_(b) {}
  double p_, q_, a_, b_;
};

/// Compliance B of the surroundings that explains the displacement of a patch, and its derivative.
struct PatchSurroundings {
  double surroundings_mm_per_N = 0;  ///< B
  double per_compliance = 1;         ///< dB/dW
};
/// B from the compliance W of a patch. Where W exceeds that of a half-space, 0.6 / (rho E*), B is the
/// difference; otherwise it is layer_base_mm_per_N() of the bonded layer whose compliance under that patch is
/// W. Both agree to second order where they meet.
/// @param compliance_mm_per_N  W; above 0
/// @param rho_mm               radius of the patch; above 0
PatchSurroundings surroundings_of_patch(double compliance_mm_per_N, double rho_mm, double modulus_N_per_mm2,
                                        double poissons_ratio);

/// Compliance W of a patch on surroundings B, the inverse of surroundings_of_patch().
double patch_compliance_mm_per_N(double surroundings_mm_per_N, double rho_mm, double modulus_N_per_mm2,
                                 double poissons_ratio);

}  // namespace palpate
