#include <gtest/gtest.h>

#include "phantoms/test_shapes.h"

namespace palpate {
namespace {

using namespace testing;

constexpr std::uint64_t kSeed = 20240611;

// Smallest distance to a patch, by successively refined grid search.
double min_distance(const Patch& patch, const Vector3d& p) {
  double best = 1e300, best_u = 0, best_v = 0;
  const auto search = [&](double u0, double v0, double reach, int steps) {
    for (int a = -steps; a <= steps; ++a) {
      for (int b = -steps; b <= steps; ++b) {
        const double u = u0 + reach * a / steps;
        const double v = v0 + reach * b / steps;
        const double d = (patch(u, v) - p).norm();
        if (d >= best) continue;
        best = d;
        best_u = u;
        best_v = v;
      }
    }
  };
  search(0.5, 0.5, 0.5, 40);
  for (double reach = 0.025; reach > 1e-9; reach *= 0.6) search(best_u, best_v, reach, 3);
  return best;
}

double brute_distance(const KnownShape& known, const Vector3d& p) {
  double best = 1e300;
  for (const Patch& patch : known.surface) best = std::min(best, min_distance(patch, p));
  return best;
}

Vector3d central_gradient(const Shape& shape, const Vector3d& p, double h = 1e-5) {
  Vector3d gradient;
  for (int a = 0; a < 3; ++a) {
    const Vector3d step = h * Vector3d::Unit(a);
    gradient[a] =
        (shape.distance_mm(Point<Patient>(p + step)) - shape.distance_mm(Point<Patient>(p - step))) / (2 * h);
  }
  return gradient;
}

TEST(Shape, DistanceIsThatOfTheNearestSurfacePoint) {
  std::mt19937_64 random(kSeed);
  for (const KnownShape& known : known_shapes()) {
    for (int n = 0; n < 40; ++n) {
      const Vector3d p = random_point(random);
      EXPECT_NEAR(std::abs(known.shape.distance_mm(Point<Patient>(p))), brute_distance(known, p), 1e-6)
          << known.name << ", seed " << kSeed << ", point " << p.transpose();
    }
  }
}

TEST(Shape, SurfacePointsHaveDistanceZeroAndItsSignIsNegativeInside) {
  for (const KnownShape& known : known_shapes()) {
    for (const Patch& patch : known.surface) {
      const Vector3d p = patch(0.37, 0.61);
      EXPECT_NEAR(known.shape.distance_mm(Point<Patient>(p)), 0, 1e-9) << known.name;
      const Vector3d n = known.shape.normal(Point<Patient>(p)).eigen();
      EXPECT_NEAR(known.shape.distance_mm(Point<Patient>(p + 0.1 * n)), 0.1, 1e-9) << known.name;
      EXPECT_NEAR(known.shape.distance_mm(Point<Patient>(p - 0.1 * n)), -0.1, 1e-9) << known.name;
    }
  }
}

TEST(Shape, NormalIsTheGradientAndHasLengthOne) {
  std::mt19937_64 random(kSeed);
  for (const KnownShape& known : known_shapes()) {
    int kinks = 0;
    for (int n = 0; n < 400; ++n) {
      const Vector3d p = random_point(random);
      const Vector3d gradient = central_gradient(known.shape, p);
      // on the medial axis the difference straddles a kink and is shorter than 1
      if (gradient.norm() < 0.999) {
        ++kinks;
        continue;
      }
      EXPECT_NEAR(gradient.norm(), 1, 1e-6) << known.name;
      EXPECT_LT((gradient - known.shape.normal(Point<Patient>(p)).eigen()).norm(), 1e-5)
          << known.name << ", seed " << kSeed << ", point " << p.transpose();
    }
    EXPECT_LE(kinks, 4) << known.name;
  }
}

TEST(Shape, NormalHasLengthOneEvenOnMedialSets) {
  for (const KnownShape& known : known_shapes()) {
    for (const auto& p :
         {patient_point(0, 0, 0), patient_point(0, 0, 3), patient_point(2, 0, 0), patient_point(9, 0, 0)}) {
      EXPECT_NEAR(known.shape.normal(p).norm(), 1, 1e-12) << known.name;
    }
  }
}

TEST(Shape, DistanceChangesByAtMostOneMillimetrePerMillimetre) {
  std::mt19937_64 random(kSeed);
  for (const KnownShape& known : known_shapes()) {
    for (int n = 0; n < 2000; ++n) {
      const Vector3d p = random_point(random), q = random_point(random);
      const double change =
          known.shape.distance_mm(Point<Patient>(p)) - known.shape.distance_mm(Point<Patient>(q));
      EXPECT_LE(std::abs(change), (p - q).norm() + 1e-9) << known.name << ", seed " << kSeed;
    }
  }
}

TEST(Shape, EachHasTheMirrorSymmetriesOfItsAxes) {
  std::mt19937_64 random(kSeed);
  std::uniform_real_distribution<double> within(-15, 15);
  for (const KnownShape& known : known_shapes()) {
    for (int n = 0; n < 50; ++n) {
      const Vector3d p(within(random), within(random), within(random));
      const double d = known.shape.distance_mm(Point<Patient>(placed(p)));
      for (int mirror = 1; mirror < 8; ++mirror) {
        const Vector3d signs(mirror & 1 ? -1 : 1, mirror & 2 ? -1 : 1, mirror & 4 ? -1 : 1);
        EXPECT_NEAR(known.shape.distance_mm(Point<Patient>(placed(p.cwiseProduct(signs)))), d, 1e-9)
            << known.name;
      }
    }
  }
}

TEST(Shape, HalfSpaceIsAPlane) {
  const Vector<Patient> n(2, -3, 6);  // length 7
  const Shape wall = Shape::half_space(Point<Patient>(1, 2, 3), n);
  EXPECT_NEAR(wall.distance_mm(Point<Patient>(1, 2, 3) + n), 7, 1e-12);
  EXPECT_NEAR(wall.distance_mm(Point<Patient>(1, 2, 3) - 2 * n), -14, 1e-12);
  EXPECT_NEAR(wall.distance_mm(Point<Patient>(1, 2, 3) + Vector<Patient>(3, 2, 0)), 0, 1e-12);
  EXPECT_NEAR((wall.normal(Point<Patient>(9, 9, 9)) - n / 7).norm(), 0, 1e-12);
}

TEST(Shape, CapsuleOfLengthZeroIsASphere) {
  const Point<Patient> c(1, 2, 3);
  const Shape capsule = Shape::capsule(c, c, 2), sphere = Shape::sphere(c, 2);
  const Point<Patient> p(4, -1, 2);
  EXPECT_EQ(capsule.distance_mm(p), sphere.distance_mm(p));
  EXPECT_EQ(capsule.normal(p), sphere.normal(p));
}

TEST(ShapeDeathTest, SizesThatMakeNoShapeAreBugs) {
  const Point<Patient> c;
  EXPECT_DEATH(Shape::sphere(c, 0), "check");
  EXPECT_DEATH(Shape::sphere(c, std::nan("")), "check");
  EXPECT_DEATH(Shape::ellipsoid(c, {1, -1, 1}), "check");
  EXPECT_DEATH(Shape::box(c, {1, 1, 1}, 2 * Matrix3d::Identity()), "check");
  EXPECT_DEATH(Shape::cylinder(c, c, 1), "check");
  EXPECT_DEATH(Shape::torus(c, Vector<Patient>(0, 0, 1), 2, 3), "check");
  EXPECT_DEATH(Shape::half_space(c, Vector<Patient>()), "check");
  EXPECT_DEATH(Shape::unite({}), "check");
}

}  // namespace
}  // namespace palpate
