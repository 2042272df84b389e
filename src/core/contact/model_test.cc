#include <gtest/gtest.h>

#include "contact/test_model.h"

namespace palpate {
namespace {

TEST(Model, FindsSegmentsByNameAndId) {
  const Model model = testing::ball_model({2, 2, 2});
  ASSERT_NE(model.find("shell"), nullptr);
  EXPECT_EQ(model.find("shell")->id, testing::kCartilage);
  EXPECT_EQ(model.find(testing::kBone)->name, "ball");
  EXPECT_EQ(model.find("Shell"), nullptr);
  EXPECT_EQ(model.find(LabelId{4}), nullptr);
}

TEST(Model, DefaultPoseIsSupineViewedFromTheFeet) {
  GridGeometry grid;
  grid.dims = {11, 21, 31};
  grid.spacing_mm = {1, 2, 0.5};
  grid.origin = Point<Patient>(-100, 30, 7);
  const auto X = supine_from_feet(grid);
  EXPECT_LT((X * grid.centre() - Point<World>()).norm(), 1e-12);
  EXPECT_EQ(X * Vector<Patient>(1, 0, 0), Vector<World>(1, 0, 0)) << "patient's left is to the right";
  EXPECT_EQ(X * Vector<Patient>(0, 0, 1), Vector<World>(0, 1, 0)) << "superior is forward";
  EXPECT_EQ(X * Vector<Patient>(0, -1, 0), Vector<World>(0, 0, 1)) << "anterior is up";
  EXPECT_NEAR(X.linear().determinant(), 1, 1e-12);
}

}  // namespace
}  // namespace palpate
