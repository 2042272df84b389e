#include <gtest/gtest.h>

#include "phantoms/shape_node.h"
#include "phantoms/test_shapes.h"

namespace palpate {
namespace {

using namespace testing;
using P = Point<Patient>;

constexpr std::uint64_t kCombineSeed = 20240613;

const Shape kLeft = Shape::sphere(P(-3, 0, 0), 5);
const Shape kRight = Shape::sphere(P(3, 0, 0), 5);

// Combinations of all shapes, deep enough that narrowing can drop operands.
std::vector<KnownShape> compounds() {
  const std::vector<KnownShape> known = known_shapes();
  const Shape all = Shape::unite({known[0].shape, known[3].shape, known[5].shape});
  const Shape soft = Shape::blend({known[1].shape, known[2].shape, known[4].shape}, 3);
  return {{"union", all, {}, 0},
          {"blend", soft, {}, 0},
          {"difference", Shape::subtract(all, soft), {}, 0},
          {"shell", Shape::subtract(Shape::offset(soft, 1.5), soft), {}, 0},
          {"rounded intersection", Shape::intersect(all, Shape::offset(known[1].shape, 2), 4), {}, 0},
          {"nested",
           Shape::unite({Shape::subtract(Shape::offset(all, 1), Shape::blend({soft, known[0].shape}, 2)),
                         Shape::intersect(known[5].shape, Shape::offset(known[3].shape, -1))}),
           {},
           0}};
}

TEST(ShapeCombine, UnionIsExactOutside) {
  const Shape both = Shape::unite({kLeft, kRight});
  EXPECT_DOUBLE_EQ(both.distance_mm(P(10, 0, 0)), 2);
  EXPECT_DOUBLE_EQ(both.distance_mm(P(-10, 0, 0)), 2);
  EXPECT_DOUBLE_EQ(both.distance_mm(P(0, 9, 0)), std::hypot(3, 9) - 5);
  EXPECT_LT(both.distance_mm(P(0, 0, 0)), 0);
  EXPECT_EQ(both.normal(P(10, 0, 0)), Vector<Patient>(1, 0, 0));
}

TEST(ShapeCombine, DifferenceTurnsTheCutSurfaceInsideOut) {
  const Shape crescent = Shape::subtract(kLeft, kRight);
  EXPECT_DOUBLE_EQ(crescent.distance_mm(P(-10, 0, 0)), 2);
  EXPECT_GT(crescent.distance_mm(P(0, 0, 0)), 0);
  EXPECT_DOUBLE_EQ(crescent.distance_mm(P(-2.5, 0, 0)), -0.5);
  EXPECT_EQ(crescent.normal(P(-2.5, 0, 0)), Vector<Patient>(1, 0, 0));
}

TEST(ShapeCombine, IntersectionKeepsTheCommonPart) {
  const Shape lens = Shape::intersect(kLeft, kRight);
  EXPECT_DOUBLE_EQ(lens.distance_mm(P(0, 0, 0)), -2);
  EXPECT_DOUBLE_EQ(lens.distance_mm(P(5, 0, 0)), 3);
  EXPECT_EQ(lens.normal(P(1.5, 0, 0)), Vector<Patient>(1, 0, 0));
}

TEST(ShapeCombine, OffsetMovesTheSurface) {
  EXPECT_DOUBLE_EQ(Shape::offset(kLeft, 1.5).distance_mm(P(-10, 0, 0)), 0.5);
  EXPECT_DOUBLE_EQ(Shape::offset(kLeft, -1.5).distance_mm(P(-10, 0, 0)), 3.5);
}

TEST(ShapeCombine, BlendFillsTheCreaseByAQuarterOfItsWidthAndNothingElse) {
  const Shape sharp = Shape::unite({kLeft, kRight}), soft = Shape::blend({kLeft, kRight}, 2);
  EXPECT_NEAR(soft.distance_mm(P(0, 6, 0)), sharp.distance_mm(P(0, 6, 0)) - 0.5, 1e-12);
  EXPECT_EQ(soft.distance_mm(P(-10, 0, 0)), sharp.distance_mm(P(-10, 0, 0)));
  std::mt19937_64 random(kCombineSeed);
  for (int n = 0; n < 500; ++n) {
    const P p(random_point(random));
    EXPECT_LE(soft.distance_mm(p), sharp.distance_mm(p));
    EXPECT_GE(soft.distance_mm(p), sharp.distance_mm(p) - 0.5 - 1e-12);
  }
}

TEST(ShapeCombine, RoundedIntersectionTakesTheEdgeOff) {
  const Shape sharp = Shape::intersect(kLeft, kRight), soft = Shape::intersect(kLeft, kRight, 2);
  EXPECT_NEAR(soft.distance_mm(P(0, 4, 0)), sharp.distance_mm(P(0, 4, 0)) + 0.5, 1e-12);
  EXPECT_EQ(soft.distance_mm(P(-8, 0, 0)), sharp.distance_mm(P(-8, 0, 0)));
}

TEST(ShapeCombine, DistanceChangesByAtMostOneMillimetrePerMillimetre) {
  std::mt19937_64 random(kCombineSeed);
  for (const KnownShape& compound : compounds()) {
    for (int n = 0; n < 1000; ++n) {
      const P p(random_point(random)), q(random_point(random));
      EXPECT_LE(std::abs(compound.shape.distance_mm(p) - compound.shape.distance_mm(q)),
                (p - q).norm() + 1e-9)
          << compound.name << ", seed " << kCombineSeed;
    }
  }
}

TEST(ShapeCombine, NormalIsTheDirectionOfTheGradient) {
  std::mt19937_64 random(kCombineSeed);
  for (const KnownShape& compound : compounds()) {
    int compared = 0;
    for (int n = 0; n < 300; ++n) {
      const Vector3d p = random_point(random);
      Vector3d forward, backward;
      const double here = compound.shape.distance_mm(P(p));
      for (int a = 0; a < 3; ++a) {
        const Vector3d step = 1e-6 * Vector3d::Unit(a);
        forward[a] = (compound.shape.distance_mm(P(p + step)) - here) / 1e-6;
        backward[a] = (here - compound.shape.distance_mm(P(p - step))) / 1e-6;
      }
      // not across a crease, nor where a blend's gradient vanishes
      if ((forward - backward).norm() > 1e-4 || forward.norm() < 0.1) continue;
      ++compared;
      EXPECT_LT((forward.normalized() - compound.shape.normal(P(p)).eigen()).norm(), 1e-3)
          << compound.name << ", seed " << kCombineSeed << ", point " << p.transpose();
    }
    EXPECT_GT(compared, 250) << compound.name;
  }
}

TEST(ShapeCombine, NarrowedToABallNothingChangesByABit) {
  std::mt19937_64 random(kCombineSeed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> fraction(0, 1);
  int narrowed = 0;
  for (const KnownShape& compound : compounds()) {
    for (int n = 0; n < 200; ++n) {
      const Ball ball{random_point(random), 6 * fraction(random)};
      const auto within = compound.shape.node()->within(compound.shape.node(), ball);
      EXPECT_EQ(within.distance, compound.shape.distance_mm(P(ball.centre)));
      if (within.node != compound.shape.node()) ++narrowed;
      for (int s = 0; s < 10; ++s) {
        const Vector3d direction = Vector3d(normal(random), normal(random), normal(random)).normalized();
        const P p(ball.centre + fraction(random) * ball.radius * direction);
        EXPECT_EQ(Shape(within.node).distance_mm(p), compound.shape.distance_mm(p))
            << compound.name << ", seed " << kCombineSeed;
      }
    }
  }
  EXPECT_GT(narrowed, 500);
}

}  // namespace
}  // namespace palpate
