#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "palpate/phantoms/primitives.h"

/// Every primitive, rotated and translated, with a parametrisation of its surface, for comparison of
/// distances by brute force.
namespace palpate::testing {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Parametrised surface patch, patient mm: complete for u, v in [0, 1]; beyond, parameters are periodic or
/// clamped.
using Patch = std::function<Vector3d(double u, double v)>;

struct KnownShape {
  std::string name;
  Shape shape;
  std::vector<Patch> surface;
  double volume_mm3;
};

inline double unit(double parameter) {
  return std::clamp(parameter, 0.0, 1.0);
}

inline Matrix3d turned() {
  return (Eigen::AngleAxisd(0.7, Vector3d(1, 2, -1).normalized()) * Eigen::AngleAxisd(0.4, Vector3d::UnitX()))
      .toRotationMatrix();
}

inline Vector3d on_unit_sphere(double u, double v) {
  const double azimuth = 2 * std::numbers::pi * u, polar = std::numbers::pi * v;
  return {std::sin(polar) * std::cos(azimuth), std::sin(polar) * std::sin(azimuth), std::cos(polar)};
}

inline Vector3d on_circle(double u) {
  return {std::cos(2 * std::numbers::pi * u), std::sin(2 * std::numbers::pi * u), 0};
}

/// Transforms local to patient coordinates, the same for all known shapes.
inline Vector3d placed(const Vector3d& local) {
  return turned() * local + Vector3d(1.3, -2.1, 0.7);
}
inline Point<Patient> patient_point(double x, double y, double z) {
  return Point<Patient>(placed(Vector3d(x, y, z)));
}

inline std::vector<KnownShape> known_shapes() {
  const double pi = std::numbers::pi;
  const auto c = patient_point(0, 0, 0);
  std::vector<KnownShape> shapes;

  shapes.push_back({"sphere",
                    Shape::sphere(c, 9),
                    {[](double u, double v) { return placed(9 * on_unit_sphere(u, v)); }},
                    4.0 / 3 * pi * 9 * 9 * 9});

  const Vector3d radii(12, 7, 4);
  shapes.push_back(
      {"ellipsoid",
       Shape::ellipsoid(c, radii, turned()),
       {[radii](double u, double v) { return placed(radii.cwiseProduct(on_unit_sphere(u, v))); }},
       4.0 / 3 * pi * radii.prod()});

  const Patch capsule_side = [](double u, double v) {
    return placed(5 * on_circle(u) + Vector3d(0, 0, 14 * unit(v) - 7));
  };
  const auto capsule_cap = [](double sign) {
    return [sign](double u, double v) {
      return placed(sign * 5 * on_unit_sphere(u, unit(v) / 2) + Vector3d(0, 0, sign * 7));
    };
  };
  shapes.push_back({"capsule",
                    Shape::capsule(patient_point(0, 0, -7), patient_point(0, 0, 7), 5),
                    {capsule_side, capsule_cap(1), capsule_cap(-1)},
                    pi * 25 * 14 + 4.0 / 3 * pi * 125});

  const Vector3d half(9, 6, 3.5);
  std::vector<Patch> faces;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      faces.push_back([=](double u, double v) {
        Vector3d p;
        p[axis] = sign;
        p[(axis + 1) % 3] = 2 * unit(u) - 1;
        p[(axis + 2) % 3] = 2 * unit(v) - 1;
        return placed(half.cwiseProduct(p));
      });
    }
  }
  shapes.push_back({"box", Shape::box(c, half, turned()), faces, 8 * half.prod()});

  const Patch cylinder_side = [](double u, double v) {
    return placed(6 * on_circle(u) + Vector3d(0, 0, 16 * unit(v) - 8));
  };
  const auto cylinder_cap = [](double z) {
    return [z](double u, double v) { return placed(6 * unit(v) * on_circle(u) + Vector3d(0, 0, z)); };
  };
  shapes.push_back({"cylinder",
                    Shape::cylinder(patient_point(0, 0, -8), patient_point(0, 0, 8), 6),
                    {cylinder_side, cylinder_cap(8), cylinder_cap(-8)},
                    pi * 36 * 16});

  shapes.push_back({"torus",
                    Shape::torus(c, Vector<Patient>(turned().col(2) * 3), 9, 3.5),
                    {[](double u, double v) {
                      const Vector3d out = on_circle(u);
                      return placed((9 + 3.5 * std::cos(2 * std::numbers::pi * v)) * out +
                                    Vector3d(0, 0, 3.5 * std::sin(2 * std::numbers::pi * v)));
                    }},
                    2 * pi * pi * 9 * 3.5 * 3.5});
  return shapes;
}

/// Uniformly distributed in a cube around the known shapes.
inline Vector3d random_point(std::mt19937_64& random, double half_extent = 18) {
  std::uniform_real_distribution<double> within(-half_extent, half_extent);
  const double x = within(random), y = within(random), z = within(random);
  return placed(Vector3d(x, y, z));
}

}  // namespace palpate::testing
