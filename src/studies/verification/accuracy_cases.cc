#include "verification/accuracy_cases.h"

#include <cmath>
#include <numbers>

#include "verification/accuracy_random.h"
#include "verification/smoothed_indicator.h"

namespace palpate {
namespace {

using Eigen::Vector3d;

constexpr double kSphere_mm = 20, kCylinder_mm = 10, kMajor_mm = 20, kMinor_mm = 8;
constexpr double kMargin_mm = 9;  // four sigma of 1.5 mm, the band, and more than a voxel's diagonal

// An orthonormal frame oblique to the grid; its third column is the axis of the shapes.
const Eigen::Matrix3d& tilted() {
  static const Eigen::Matrix3d frame =
      shortest_rotation(Vector3d::UnitZ(), Vector3d(0.36, 0.48, 0.8)).toRotationMatrix();
  return frame;
}

std::vector<Point<Patient>> scatter(int count, std::uint64_t seed,
                                    const std::function<Vector3d(AccuracyRandom&)>& sample_point) {
  AccuracyRandom random(seed);
  std::vector<Point<Patient>> points;
  for (int n = 0; n < count; ++n) points.emplace_back(sample_point(random));
  return points;
}

double band(AccuracyRandom& random) {
  return random.between(-kSurfaceBand_mm, kSurfaceBand_mm);
}

AccuracyCase sphere_case(int points) {
  return {"sphere-20mm",
          Shape::sphere({}, kSphere_mm),
          kSphere_mm + kMargin_mm,
          scatter(points, 1,
                  [](AccuracyRandom& random) {
                    const Vector3d out = random.direction();
                    return Vector3d((kSphere_mm + band(random)) * out);
                  }),
          [](const Point<Patient>& p, double sigma) {
            return smoothed_ball(p.eigen().norm(), kSphere_mm, sigma);
          },
          true};
}

AccuracyCase cylinder_case(int points) {
  const double along = 10;
  // longer than any diagonal of the volume, so that its caps are outside
  const Point<Patient> end(100 * tilted().col(2)), start(-100 * tilted().col(2));
  return {"cylinder-10mm", Shape::cylinder(start, end, kCylinder_mm), kCylinder_mm + along + kMargin_mm,
          scatter(points, 2,
                  [along](AccuracyRandom& random) {
                    const double turn = random.between(0, 2 * std::numbers::pi),
                                 rho = kCylinder_mm + band(random);
                    return Vector3d(tilted() * Vector3d(rho * std::cos(turn), rho * std::sin(turn),
                                                        random.between(-along, along)));
                  }),
          [](const Point<Patient>& p, double sigma) {
            const Vector3d q = tilted().transpose() * p.eigen();
            return smoothed_disc(std::hypot(q.x(), q.y()), kCylinder_mm, sigma);
          }};
}

AccuracyCase plane_case(int points) {
  const double lateral = 12;
  const Vector<Patient> normal(tilted().col(2));
  return {"tilted-plane", Shape::half_space({}, normal), lateral * std::numbers::sqrt2 + kMargin_mm,
          scatter(points, 3,
                  [lateral](AccuracyRandom& random) {
                    const double u = random.between(-lateral, lateral), v = random.between(-lateral, lateral);
                    return Vector3d(tilted() * Vector3d(u, v, band(random)));
                  }),
          [normal](const Point<Patient>& p, double sigma) {
            return smoothed_half_space(normal.eigen().dot(p.eigen()), sigma);
          }};
}

AccuracyCase torus_case(int points) {
  return {
      "torus-20-8mm",
      Shape::torus({}, Vector<Patient>(tilted().col(2)), kMajor_mm, kMinor_mm),
      kMajor_mm + kMinor_mm + kMargin_mm,
      scatter(points, 4,
              [](AccuracyRandom& random) {
                // uniform on the surface: the area element is proportional to the distance from the axis
                double around = 0;
                do {
                  around = random.between(0, 2 * std::numbers::pi);
                } while (random.between(0, kMajor_mm + kMinor_mm) > kMajor_mm + kMinor_mm * std::cos(around));
                const double turn = random.between(0, 2 * std::numbers::pi), r = kMinor_mm + band(random);
                const double rho = kMajor_mm + r * std::cos(around);
                return Vector3d(tilted() *
                                Vector3d(rho * std::cos(turn), rho * std::sin(turn), r * std::sin(around)));
              }),
      [](const Point<Patient>& p, double sigma) {
        const Vector3d q = tilted().transpose() * p.eigen();
        return smoothed_torus(std::hypot(q.x(), q.y()), q.z(), kMajor_mm, kMinor_mm, sigma);
      },
      true};
}

}  // namespace

std::vector<AccuracyCase> accuracy_cases(int points) {
  return {sphere_case(points), cylinder_case(points), plane_case(points), torus_case(points)};
}

const std::array<AccuracySpacing, 3>& accuracy_spacings() {
  static const std::array<AccuracySpacing, 3> all = {{{"0.28x0.28x1.0", {0.28, 0.28, 1.0}},
                                                      {"0.625x0.625x0.9", {0.625, 0.625, 0.9}},
                                                      {"0.3x0.3x0.3", {0.3, 0.3, 0.3}}}};
  return all;
}

GridGeometry accuracy_grid(const AccuracyCase& shape, const Vector3d& spacing_mm) {
  GridGeometry grid;
  grid.spacing_mm = spacing_mm;
  Vector3d last;
  for (int a = 0; a < 3; ++a) {
    const int n = static_cast<int>(std::ceil(2 * shape.half_extent_mm / spacing_mm[a])) + 1;
    grid.dims[static_cast<std::size_t>(a)] = n;
    last[a] = n - 1;
  }
  const Vector3d shift(0.31, 0.17, 0.43);
  grid.origin = Point<Patient>(spacing_mm.cwiseProduct(shift - 0.5 * last));
  return grid;
}

}  // namespace palpate
