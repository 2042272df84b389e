#include <algorithm>
#include <cmath>

#include "phantoms/shape_ellipsoid.h"
#include "phantoms/shape_node.h"

namespace palpate {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// unit vector along v, or `otherwise` for the zero vector
Vector3d direction_or(const Vector3d& v, const Vector3d& otherwise) {
  const double length = v.norm();
  return length > 0 ? Vector3d(v / length) : otherwise;
}

void check_size(double millimetres) {
  PALPATE_CHECK(std::isfinite(millimetres) && millimetres > 0);
}

void check_axes(const Matrix3d& axes) {
  PALPATE_CHECK((axes.transpose() * axes - Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-9);
}

struct Sphere final : Shape::Node {
  Sphere(const Vector3d& c, double r) : centre(c), radius(r) {}
  double distance(const Vector3d& p) const override { return (p - centre).norm() - radius; }
  Vector3d gradient(const Vector3d& p) const override { return direction_or(p - centre, Vector3d::UnitZ()); }

  Vector3d centre;
  double radius;
};

struct Ellipsoid final : Shape::Node {
  Ellipsoid(const Vector3d& c, const Vector3d& r, const Matrix3d& a) : centre(c), radii(r), axes(a) {}
  double distance(const Vector3d& p) const override {
    return nearest_on_ellipsoid(axes.transpose() * (p - centre), radii).distance;
  }
  Vector3d gradient(const Vector3d& p) const override {
    const Vector3d surface = nearest_on_ellipsoid(axes.transpose() * (p - centre), radii).point;
    return axes * surface.cwiseQuotient(radii.cwiseAbs2()).normalized();
  }

  Vector3d centre, radii;
  Matrix3d axes;
};

struct Capsule final : Shape::Node {
  Capsule(const Vector3d& start, const Vector3d& end, double r)
      : a(start),
        axis(end - start),
        inverse_squared_length(1 / std::max(axis.squaredNorm(), 1e-300)),
        radius(r) {}
  Vector3d from_axis(const Vector3d& p) const {
    const Vector3d q = p - a;
    return q - axis * std::clamp(q.dot(axis) * inverse_squared_length, 0.0, 1.0);
  }
  double distance(const Vector3d& p) const override { return from_axis(p).norm() - radius; }
  Vector3d gradient(const Vector3d& p) const override {
    return direction_or(from_axis(p), axis.norm() > 0 ? axis.unitOrthogonal() : Vector3d::UnitZ());
  }

  Vector3d a, axis;
  double inverse_squared_length, radius;
};

struct Box final : Shape::Node {
  Box(const Vector3d& c, const Vector3d& h, const Matrix3d& a) : centre(c), half(h), axes(a) {}
  double distance(const Vector3d& p) const override {
    const Vector3d beyond = (axes.transpose() * (p - centre)).cwiseAbs() - half;
    return beyond.cwiseMax(0.0).norm() + std::min(beyond.maxCoeff(), 0.0);
  }
  Vector3d gradient(const Vector3d& p) const override {
    const Vector3d q = axes.transpose() * (p - centre);
    const Vector3d beyond = q.cwiseAbs() - half;
    // inside: the nearest face; outside: away from the nearest point of the box
    Eigen::Index face = 0;
    const bool inside = beyond.maxCoeff(&face) <= 0;
    const Vector3d n = inside ? Vector3d::Unit(face) : Vector3d(beyond.cwiseMax(0.0).normalized());
    const Vector3d sign = q.unaryExpr([](double v) { return v < 0 ? -1.0 : 1.0; });
    return axes * n.cwiseProduct(sign);
  }

  Vector3d centre, half;
  Matrix3d axes;
};

// A finite cylinder is the solid of revolution of a rectangle.
struct Cylinder final : Shape::Node {
  Cylinder(const Vector3d& a, const Vector3d& b, double r)
      : centre(0.5 * (a + b)), axis((b - a).normalized()), half_length(0.5 * (b - a).norm()), radius(r) {}
  double distance(const Vector3d& p) const override {
    const Vector3d q = p - centre;
    const double along = q.dot(axis);
    const double radial = (q - along * axis).norm() - radius;
    const double axial = std::abs(along) - half_length;
    return std::hypot(std::max(radial, 0.0), std::max(axial, 0.0)) + std::min(std::max(radial, axial), 0.0);
  }
  Vector3d gradient(const Vector3d& p) const override {
    const Vector3d q = p - centre;
    const double along = q.dot(axis);
    const Vector3d outward = direction_or(q - along * axis, axis.unitOrthogonal());
    const Vector3d to_cap = along < 0 ? Vector3d(-axis) : axis;
    const double radial = (q - along * axis).norm() - radius;
    const double axial = std::abs(along) - half_length;
    if (radial > 0 && axial > 0) return (radial * outward + axial * to_cap).normalized();
    return radial > axial ? outward : to_cap;
  }

  Vector3d centre, axis;
  double half_length, radius;
};

struct Torus final : Shape::Node {
  Torus(const Vector3d& c, const Vector3d& a, double major_radius, double minor_radius)
      : centre(c), axis(a), major(major_radius), minor(minor_radius) {}
  Vector3d from_ring(const Vector3d& p) const {
    const Vector3d q = p - centre;
    const Vector3d in_plane = q - q.dot(axis) * axis;
    return q - major * direction_or(in_plane, axis.unitOrthogonal());
  }
  double distance(const Vector3d& p) const override { return from_ring(p).norm() - minor; }
  Vector3d gradient(const Vector3d& p) const override { return direction_or(from_ring(p), axis); }

  Vector3d centre, axis;
  double major, minor;
};

struct HalfSpace final : Shape::Node {
  HalfSpace(const Vector3d& n, double level) : outward(n), offset(level) {}
  double distance(const Vector3d& p) const override { return outward.dot(p) - offset; }
  Vector3d gradient(const Vector3d&) const override { return outward; }

  Vector3d outward;
  double offset;
};

}  // namespace

Shape Shape::sphere(const Point<Patient>& centre, double radius_mm) {
  PALPATE_CHECK(centre.all_finite());
  check_size(radius_mm);
  return Shape(std::make_shared<Sphere>(centre.eigen(), radius_mm));
}

Shape Shape::ellipsoid(const Point<Patient>& centre, const Vector3d& radii_mm, const Matrix3d& axes) {
  PALPATE_CHECK(centre.all_finite());
  for (const double radius : radii_mm) check_size(radius);
  check_axes(axes);
  return Shape(std::make_shared<Ellipsoid>(centre.eigen(), radii_mm, axes));
}

Shape Shape::capsule(const Point<Patient>& a, const Point<Patient>& b, double radius_mm) {
  PALPATE_CHECK(a.all_finite() && b.all_finite());
  check_size(radius_mm);
  return Shape(std::make_shared<Capsule>(a.eigen(), b.eigen(), radius_mm));
}

Shape Shape::box(const Point<Patient>& centre, const Vector3d& half_extents_mm, const Matrix3d& axes) {
  PALPATE_CHECK(centre.all_finite());
  for (const double half : half_extents_mm) check_size(half);
  check_axes(axes);
  return Shape(std::make_shared<Box>(centre.eigen(), half_extents_mm, axes));
}

Shape Shape::cylinder(const Point<Patient>& a, const Point<Patient>& b, double radius_mm) {
  PALPATE_CHECK(a.all_finite() && b.all_finite());
  check_size((b - a).norm());
  check_size(radius_mm);
  return Shape(std::make_shared<Cylinder>(a.eigen(), b.eigen(), radius_mm));
}

Shape Shape::torus(const Point<Patient>& centre, const Vector<Patient>& axis, double major_radius_mm,
                   double minor_radius_mm) {
  PALPATE_CHECK(centre.all_finite());
  check_size(axis.norm());
  check_size(minor_radius_mm);
  PALPATE_CHECK(std::isfinite(major_radius_mm) && major_radius_mm > minor_radius_mm);
  return Shape(
      std::make_shared<Torus>(centre.eigen(), axis.normalized().eigen(), major_radius_mm, minor_radius_mm));
}

Shape Shape::half_space(const Point<Patient>& point, const Vector<Patient>& outward_normal) {
  PALPATE_CHECK(point.all_finite());
  check_size(outward_normal.norm());
  const Vector3d n = outward_normal.normalized().eigen();
  return Shape(std::make_shared<HalfSpace>(n, n.dot(point.eigen())));
}

}  // namespace palpate
