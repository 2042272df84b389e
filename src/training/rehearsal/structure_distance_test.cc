#include "palpate/rehearsal/structure_distance.h"

#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"
#include "contact/test_model.h"

namespace palpate {
namespace {

Eigen::Vector3d random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

TEST(StructureDistance, OfABallAtAnyRange) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> range(0.5, 120);
  const Model model = testing::with_exact_surfaces(testing::ball_model());
  const StructureDistance ball(testing::kBone, model.surfaces[0].surface);
  EXPECT_EQ(ball.label(), testing::kBone);
  EXPECT_GT(ball.near_mm(), 2);
  double worst_near_mm = 0, worst_far_mm = 0;
  for (int n = 0; n < 4000; ++n) {
    const double r = range(random), exact_mm = r - testing::kBoneRadius_mm;
    const double off_mm = ball.distance_mm(Point<Patient>(r * random_direction(random))) - exact_mm;
    double& worst = std::abs(exact_mm) < ball.near_mm() - 0.1 ? worst_near_mm : worst_far_mm;
    worst = std::max(worst, std::abs(off_mm));
  }
  EXPECT_LT(worst_near_mm, 0.02);
  EXPECT_LT(worst_far_mm, 0.08);
}

TEST(StructureDistance, CoversUntouchableStructures) {
  // bone up to 15 mm, then fat, which is not touchable, up to 24 mm; the shell has no voxel
  const Model model = testing::with_exact_surfaces(testing::ball_model({1, 1, 1}));
  const auto distances = structure_distances(model);
  ASSERT_TRUE(distances) << distances.error().message();
  ASSERT_EQ(distances->size(), 2u);
  EXPECT_EQ((*distances)[0].label(), testing::kBone);
  EXPECT_EQ((*distances)[1].label(), testing::kFat);
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> range(1, 60);
  for (int n = 0; n < 1000; ++n) {
    const double r = range(random);
    const double exact_mm = std::max(r - 24, testing::kBoneRadius_mm - r);
    // a surface between voxels is accurate to a fraction of the voxel size
    EXPECT_NEAR((*distances)[1].distance_mm(Point<Patient>(r * random_direction(random))), exact_mm, 0.35)
        << r;
  }
}

}  // namespace
}  // namespace palpate
