#pragma once

#include <Eigen/Core>

namespace palpate {

struct NearestOnEllipsoid {
  Eigen::Vector3d point;  ///< Point on the surface, in the ellipsoid's own axes.
  double distance;        ///< Signed distance; negative inside.
};

/// Nearest point to p on the ellipsoid sum (x_i / radii_i)^2 = 1. The Lagrange multiplier is found by
/// Newton's method on the reciprocal norm, which converges monotonically without safeguards; see the source.
/// If several points are equally near, any of them.
NearestOnEllipsoid nearest_on_ellipsoid(const Eigen::Vector3d& p, const Eigen::Vector3d& radii);

}  // namespace palpate
