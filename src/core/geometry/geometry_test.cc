#include "palpate/geometry/geometry.h"

#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"

namespace palpate {
namespace {

// mixing frames must not compile: requires-expressions test each operation
template <class A, class B>
concept Adds = requires(A a, B b) {
  a + b;
};
template <class A, class B>
concept Subtracts = requires(A a, B b) {
  a - b;
};
template <class A, class B>
concept Multiplies = requires(A a, B b) {
  a* b;
};
template <class A, class B>
concept Dots = requires(A a, B b) {
  a.dot(b);
};
template <class A, class B>
concept Assigns = requires(A a, B b) {
  a = b;
};

static_assert(Adds<Point<Patient>, Vector<Patient>>);
static_assert(!Adds<Point<Patient>, Vector<World>>);
static_assert(!Adds<Point<Patient>, Point<Patient>>, "points do not add");
static_assert(Adds<Vector<World>, Vector<World>>);
static_assert(!Adds<Vector<World>, Vector<Device>>);
static_assert(Subtracts<Point<Voxel>, Point<Voxel>>);
static_assert(!Subtracts<Point<Voxel>, Point<Patient>>);
static_assert(Dots<Vector<Patient>, Vector<Patient>>);
static_assert(!Dots<Vector<Patient>, Vector<World>>);
static_assert(!Assigns<Point<Patient>, Point<World>>);
static_assert(!Assigns<Vector<Patient>, Point<Patient>>, "a point is not a vector");
static_assert(Multiplies<Transform<World, Patient>, Point<Patient>>);
static_assert(!Multiplies<Transform<World, Patient>, Point<World>>);
static_assert(Multiplies<Transform<World, Patient>, Transform<Patient, Voxel>>);
static_assert(!Multiplies<Transform<World, Patient>, Transform<World, Patient>>, "composition must cancel");
static_assert(Multiplies<Rotation<World, Device>, Vector<Device>>);
static_assert(!Multiplies<Rotation<World, Device>, Vector<World>>);
static_assert(!std::is_constructible_v<Point<Patient>, Point<World>>);
static_assert(!std::is_constructible_v<Vector<Patient>, Vector<World>>);

class GeometryTest : public testing::Test {
 protected:
  void SetUp() override {
    const auto seed = test::test_seed();
    RecordProperty("seed", std::to_string(seed));
    std::printf("seed %u\n", seed);
    random_.seed(seed);
  }
  double uniform() { return std::uniform_real_distribution<double>(-50, 50)(random_); }
  Eigen::Vector3d vector() { return {uniform(), uniform(), uniform()}; }
  Eigen::Quaterniond quaternion() {
    return Eigen::Quaterniond(uniform(), uniform(), uniform(), uniform()).normalized();
  }
  std::mt19937 random_;
};

TEST_F(GeometryTest, TransformsComposeAndInvert) {
  for (int i = 0; i < 1000; ++i) {
    const Transform<World, Patient> X_WP{Rotation<World, Patient>(quaternion()), Vector<World>(vector())};
    const Eigen::Matrix3d stored =
        quaternion().toRotationMatrix() * Eigen::Vector3d(0.3, -0.3, 1).asDiagonal();
    const Transform<Patient, Voxel> X_PV(stored, vector());
    const Point<Voxel> p(vector());
    const Point<World> one_by_one = X_WP * (X_PV * p);
    const Point<World> at_once = (X_WP * X_PV) * p;
    EXPECT_LT((one_by_one - at_once).norm(), 1e-10);
    EXPECT_LT(((X_WP * X_PV).inverse() * at_once - p).norm(), 1e-9);
  }
}

TEST_F(GeometryTest, VectorsIgnoreTranslationAndKeepTheirLength) {
  const Transform<World, Patient> X{Rotation<World, Patient>(quaternion()), Vector<World>(vector())};
  for (int i = 0; i < 100; ++i) {
    const Point<Patient> a(vector()), b(vector());
    EXPECT_LT(((X * b - X * a) - X * (b - a)).norm(), 1e-10);
    EXPECT_NEAR((X * (b - a)).norm(), (b - a).norm(), 1e-10);
  }
}

TEST_F(GeometryTest, RotationsActAsTheirMatricesAndInvert) {
  for (int i = 0; i < 100; ++i) {
    const Rotation<World, Patient> R(quaternion());
    const Rotation<Patient, Voxel> S(quaternion());
    const Vector<Voxel> v(vector());
    EXPECT_LT(((R * S) * v - R * (S * v)).norm(), 1e-10);
    const Vector<Patient> w(vector());
    EXPECT_LT((R.inverse() * (R * w) - w).norm(), 1e-10);
    EXPECT_LT((R * w).eigen().cross(R.quaternion().toRotationMatrix() * w.eigen()).norm(), 1e-9);
  }
}

TEST_F(GeometryTest, SlerpTurnsEvenlyAlongTheShorterArc) {
  const auto start = Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), 0.2);
  const auto end = Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), 1.0);
  for (const double t : {0.0, 0.25, 0.5, 1.0}) {
    const auto expected = Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), 0.2 + 0.8 * t);
    EXPECT_NEAR(start.slerp(t, end).quaternion().angularDistance(expected.quaternion()), 0, 1e-12);
  }
  // q and -q are one rotation
  const Rotation<World, World> negated(Eigen::Quaterniond(-end.quaternion().coeffs()));
  EXPECT_NEAR(start.slerp(0.5, negated).quaternion().angularDistance(start.slerp(0.5, end).quaternion()), 0,
              1e-12);
}

TEST_F(GeometryTest, TheSmallestTurnLeadsOneDirectionOntoAnother) {
  for (int n = 0; n < 1000; ++n) {
    const Eigen::Vector3d from = vector();
    // arbitrary, nearly parallel, nearly opposite, opposite
    const Eigen::Vector3d onto = n % 4 == 0   ? Eigen::Vector3d(vector())
                                 : n % 4 == 1 ? Eigen::Vector3d(2 * from + 1e-7 * vector())
                                 : n % 4 == 2 ? Eigen::Vector3d(-from + 1e-4 * vector())
                                              : Eigen::Vector3d(-3 * from);
    const Eigen::Quaterniond turn = shortest_rotation(from, onto);
    EXPECT_NEAR(turn.norm(), 1, 1e-9);
    EXPECT_LT((turn * from.normalized() - onto.normalized()).norm(), 1e-6);
    // about an axis perpendicular to both, and by no more than the angle between them
    EXPECT_NEAR(turn.vec().dot(from.normalized()), 0, 1e-9);
    EXPECT_GE(turn.w(), 0);
  }
}

TEST_F(GeometryTest, TheZeroVectorNormalisesToItself) {
  EXPECT_EQ(Vector<World>().normalized(), Vector<World>());
}

TEST(GeometryDeathTest, ASingularTransformHasNoInverse) {
  const Transform<Patient, Voxel> flat(Eigen::Vector3d(1, 1, 0).asDiagonal(), Eigen::Vector3d::Zero());
  EXPECT_DEATH((void)flat.inverse(), "bug: check");
}

}  // namespace
}  // namespace palpate
