#pragma once

#include <Eigen/Core>

namespace palpate {

struct NearestOnEllipsoid {
  Eigen::Vector3d point;  ///< of the surface, in the ellipsoid's own axes
  double distance;        ///< signed, negative inside
};

/// The point of the ellipsoid sum (x_i / radii_i)^2 = 1 nearest to p (Lagrange multiplier found by
/// Newton's method on the reciprocal norm, which converges from one side without safeguards; see the
/// source). Where several points are equally near, any of them.
NearestOnEllipsoid nearest_on_ellipsoid(const Eigen::Vector3d& p, const Eigen::Vector3d& radii);

}  // namespace palpate
