#include "phantoms/shape_ellipsoid.h"

#include <algorithm>
#include <cmath>

// The nearest point x of a surface point to y (first octant, radii e_i) satisfies y - x = t (x_i / e_i^2),
// so x_i = e_i^2 y_i / (t + e_i^2), where t is the largest root of
//   Q(t) = sum (e_i y_i / (t + e_i^2))^2 = 1.
// With s = t + e_min^2 and gap_i = e_i^2 - e_min^2 >= 0 the wanted root is the only one with s > 0, and
// nothing cancels near it. Q falls from infinity (if y_min > 0) to 0. G(s) = Q^(-1/2) - 1 is increasing,
// concave and nearly straight (it is straight for a sphere), so Newton's steps from a start with Q >= 1
// grow towards the root and never pass it.
namespace palpate {
namespace {

using Eigen::Vector3d;

struct Octant {
  Vector3d y;  // the query point, all components >= 0
  Vector3d radii;
  double smallest;  // the smallest radius
  Vector3d gap;     // e_i^2 - smallest^2, computed as a product so that nearly equal radii do not cancel
};

double sum_of_squares(const Octant& o, double s, double* slope) {
  double q = 0, dq = 0;
  for (int i = 0; i < 3; ++i) {
    if (o.y[i] == 0) continue;
    const double denominator = s + o.gap[i];
    const double term = o.radii[i] * o.y[i] / denominator;
    q += term * term;
    dq -= 2 * term * term / denominator;
  }
  *slope = dq;
  return q;
}

double root(const Octant& o) {
  // start where a single term is 1
  double s = 0;
  for (int i = 0; i < 3; ++i) s = std::max(s, o.radii[i] * o.y[i] - o.gap[i]);
  for (int step = 0; step < 60; ++step) {
    double slope = 0;
    const double q = sum_of_squares(o, s, &slope);
    if (!(q > 1)) break;
    const double next = s + 2 * q * (1 - std::sqrt(q)) / slope;
    if (!(next > s)) break;
    s = next;
  }
  return s;
}

// True if the query lies on a plane of symmetry, so close to the centre that its nearest points are off the
// plane.
bool leaves_plane(const Octant& o) {
  double inside = 0;
  for (int i = 0; i < 3; ++i) {
    if (o.gap[i] == 0) {
      if (o.y[i] > 0) return false;
    } else {
      const double ratio = o.radii[i] * o.y[i] / o.gap[i];
      inside += ratio * ratio;
    }
  }
  return inside < 1;
}

Vector3d nearest_off_plane(const Octant& o) {
  Vector3d x = Vector3d::Zero();
  double rest = 1;
  int thin = 0;
  for (int i = 0; i < 3; ++i) {
    if (o.gap[i] == 0) {
      thin = i;
    } else {
      x[i] = o.radii[i] * o.radii[i] * o.y[i] / o.gap[i];
      rest -= (x[i] / o.radii[i]) * (x[i] / o.radii[i]);
    }
  }
  x[thin] = o.smallest * std::sqrt(std::max(rest, 0.0));
  return x;
}

}  // namespace

NearestOnEllipsoid nearest_on_ellipsoid(const Vector3d& p, const Vector3d& radii) {
  // components whose squares would underflow are treated as zero
  const Vector3d y = p.cwiseAbs().unaryExpr([](double v) { return v < 1e-150 ? 0.0 : v; });
  Octant o{y, radii, radii.minCoeff(), Vector3d::Zero()};
  for (int i = 0; i < 3; ++i) o.gap[i] = (radii[i] - o.smallest) * (radii[i] + o.smallest);

  Vector3d x;
  if (leaves_plane(o)) {
    x = nearest_off_plane(o);
  } else {
    const double s = root(o);
    for (int i = 0; i < 3; ++i) x[i] = o.y[i] == 0 ? 0.0 : radii[i] * radii[i] * o.y[i] / (s + o.gap[i]);
  }

  const bool inside = p.cwiseQuotient(radii).squaredNorm() < 1;
  const double distance = (o.y - x).norm();
  for (int i = 0; i < 3; ++i) x[i] = std::copysign(x[i], p[i]);
  return {x, inside ? -distance : distance};
}

}  // namespace palpate
