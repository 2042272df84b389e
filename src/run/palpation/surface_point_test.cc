#include <gtest/gtest.h>

#include "loading/test_loading.h"

namespace palpate {
namespace {

using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;

TEST(SurfacePoint, LiesOnTheSurfaceWithItsNormalAndAFreeWay) {
  const Model model = testing::ball_model();
  const auto found = find_surface_point(model, kBone, 8);
  ASSERT_TRUE(found.ok());
  EXPECT_NEAR(found->point.eigen().norm(), kBoneRadius_mm, 0.1);
  EXPECT_GT(found->normal.dot(Vector<Patient>(found->point.eigen()).normalized()), 0.998);
  EXPECT_EQ(found->clearance_mm, 8);
}

TEST(SurfacePoint, CartilageIsFoundAndTheBoneItCoversIsNot) {
  const Model model = testing::ball_model({0.6, 0.6, 0.6}, 0.7, 3);
  const auto cartilage = find_surface_point(model, kCartilage, 5);
  ASSERT_TRUE(cartilage.ok());
  EXPECT_NEAR(cartilage->point.eigen().norm(), kBoneRadius_mm + 3, 0.15);
  const auto bone = find_surface_point(model, kBone, 5);
  ASSERT_FALSE(bone.ok());
  EXPECT_NE(bone.error().what.find("covered"), std::string::npos);
}

TEST(SurfacePoint, ACutAtTheVolumesBorderIsNoSurface) {
  // a column through the whole volume: its ends are cut faces, its side is a surface; a flat disc in the
  // middle has both
  for (const bool column : {true, false}) {
    Model model = testing::ball_model({1, 1, 1});
    const GridGeometry& grid = model.labels->geometry();
    Volume<LabelId> labels(grid);
    Volume<std::uint16_t> field(grid);
    const auto X = grid.X_PatientVoxel();
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i) {
          const Point<Patient> p = X * Point<Voxel>(i, j, k);
          const double side = std::hypot(p.x(), p.y()) - 10, end = std::abs(p.z()) - (column ? 1000 : 3);
          field.at(i, j, k) =
              static_cast<std::uint16_t>(std::lround(65535 * testing::ramp(std::max(side, end), 1.0)));
          labels.at(i, j, k) = std::max(side, end) < 0 ? kBone : LabelId{0};
        }
    model.labels = label_bricks(labels);
    model.field = std::make_shared<const Field>(std::move(field));
    const auto found = find_surface_point(model, kBone, 8);
    ASSERT_TRUE(found.ok()) << found.error().message();
    EXPECT_EQ(std::abs(found->normal.z()) < 0.3, column) << "the disc is touched on its flat";
  }
}

TEST(SurfacePoint, OfRampsIsFoundAsWell) {
  const Model bare = testing::with_ramps(testing::ball_model(), 4);
  const auto ball = find_surface_point(bare, kBone, 8);
  ASSERT_TRUE(ball.ok());
  EXPECT_NEAR(ball->point.eigen().norm(), kBoneRadius_mm, 0.5);
  EXPECT_GT(ball->normal.dot(Vector<Patient>(ball->point.eigen()).normalized()), 0.99);
  EXPECT_EQ(ball->clearance_mm, 8);

  const Model covered = testing::with_ramps(testing::ball_model({0.6, 0.6, 0.6}, 0.7, 3), 4, 3);
  const auto cartilage = find_surface_point(covered, kCartilage, 5);
  ASSERT_TRUE(cartilage.ok());
  EXPECT_NEAR(cartilage->point.eigen().norm(), kBoneRadius_mm + 3, 0.5);
  EXPECT_FALSE(find_surface_point(covered, kBone, 5).ok());
}

TEST(SurfacePoint, RejectsStructuresWithoutContact) {
  const Model model = testing::ball_model();
  const auto found = find_surface_point(model, testing::kFat, 5);
  ASSERT_FALSE(found.ok());
  EXPECT_NE(found.error().what.find("not touchable"), std::string::npos);
}

}  // namespace
}  // namespace palpate
