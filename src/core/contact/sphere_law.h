#pragma once

#include "palpate/contact/bonded_layer.h"
#include "palpate/contact/soft_contact.h"

/// Depth of a sphere as a function of its force (docs/concepts/tissue.md, "In the tick").
namespace palpate {

/// Depth of a rigid sphere at the force F = s^3: d0 + B F with B >= 0, d0 H(-B F / d0) with B < 0
/// (LayerFactor), minus the C term (stiffening_depth_mm). d0 is the depth in a half-space (Sneddon 1965, Int
/// J Eng Sci 3:47), by a rational fit within 0.4 % for depths to seven radii. Increases with s; without a C
/// term the compliance dd/dF decreases.
class SphereLaw {
 public:
  SphereLaw(const ContactLaw& tissue, double radius_mm);

  struct Depth {
    double mm, per_s;
  };
  Depth at(double s) const;
  double compliance_mm_per_N(double s) const { return at(s).per_s / (3 * s * s); }
  /// s at a depth above 0.
  double s_at_depth(double depth_mm) const;
  /// First s up to `end` at which the compliance is less than `min_compliance_mm_per_N`; infinite: none.
  double first_s_below_compliance(double end, double min_compliance_mm_per_N) const;

  /// Integrals over the force, 0 ... s^3: of the depth, and of its derivatives with respect to B and -C.
  struct Integrals {
    double depth_mJ, of_surroundings_N2, of_stiffening_N3;
  };
  Integrals integrals(double s) const;
  /// Derivatives of the depth with respect to B and -C at a given force.
  double per_surroundings_N(double s) const;
  double per_stiffening_N2(double s) const;

 private:
  // depth without the C term
  Depth elastic(double s) const;
  double elastic_per_surroundings_N(double s) const;
  // derivative of the C term with respect to C
  double per_c_N2(double s) const;
  double elastic_compliance_mm_per_N(double s) const { return elastic(s).per_s / (3 * s * s); }

  LayerFactor layer_;
  double b_, c_;
  double k_;  ///< Hertz's depth is k s^2
  /// -B / k where B is below 0, otherwise 0. The argument of LayerFactor is base_ s / P, with P the ratio of
  /// the depth in a half-space to that of a paraboloid (sphere_factor()).
  double base_;
  double kappa_;  ///< Hertz's contact radius is kappa s sphere radii
  double reference_N_, reference_s_;
  bool is_clamped_ = false;  ///< C is limited, and so depends on B alone
  double c_per_b_ = 0;
};

}  // namespace palpate
