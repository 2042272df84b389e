#pragma once

#include <array>

#include "palpate/phantoms/primitives.h"

namespace palpate {

/// A weight along one axis of the grid: even, its integral 1, 0 beyond its reach.
class AxisWeight {
 public:
  /// A Gaussian, cut where nothing is left of it.
  static AxisWeight gaussian(double sigma_mm);
  /// 35/(32 R) (1 - (x/R)^2)^3: what the smooth sphere weighs with, without voxels.
  static AxisWeight compact(double radius_mm);

  double reach_mm() const { return reach_mm_; }
  double density(double x_mm) const;
  /// Integral of the density up to x, 0 ... 1.
  double integral(double x_mm) const;

 private:
  AxisWeight(double reach_mm, double sigma_mm) : reach_mm_(reach_mm), sigma_mm_(sigma_mm) {}

  double reach_mm_;
  double sigma_mm_;  // 0: compact
};

/// The solid (1 inside, 0 outside) convolved with a product of weights along the patient's axes, at p, by
/// quadrature to better than 1e-5 for surfaces whose radii of curvature are several times the reach: exact
/// between the surface's crossings along lines of the axis nearest to the normal, Gauss-Legendre over the
/// lines. The shape's distance has to be exact there.
double smoothed_solid(const Shape& shape, const Point<Patient>& p, const std::array<AxisWeight, 3>& weights);

}  // namespace palpate
