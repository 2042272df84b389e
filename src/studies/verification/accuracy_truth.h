#pragma once

#include <array>

#include "palpate/phantoms/primitives.h"

namespace palpate {

/// An even weight function along one axis, with integral 1 and compact support.
class AxisWeight {
 public:
  /// Gaussian, truncated where it is negligible.
  static AxisWeight gaussian(double sigma_mm);
  /// Continuous kernel of the smooth sphere: 35/(32 R) (1 - (x/R)^2)^3.
  static AxisWeight compact(double radius_mm);

  double reach_mm() const { return reach_mm_; }
  double density(double x_mm) const;
  /// Integral of the density up to x, 0 ... 1.
  double integral(double x_mm) const;

 private:
  AxisWeight(double reach_mm, double sigma_mm) : reach_mm_(reach_mm), sigma_mm_(sigma_mm) {}

  double reach_mm_;
  double sigma_mm_;  // 0: the compact kernel
};

/// Convolution of a solid (1 inside, 0 outside) with a product of weights along the patient's axes, at p.
/// Accurate to 1e-5 for surfaces with radii of curvature of several times the reach: exact between the
/// surface's crossings along lines of the axis nearest to the normal, Gauss-Legendre quadrature over the
/// lines. The shape's distance has to be exact within the reach.
double smoothed_solid(const Shape& shape, const Point<Patient>& p, const std::array<AxisWeight, 3>& weights);

}  // namespace palpate
