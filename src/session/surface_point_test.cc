#include <gtest/gtest.h>

#include "session/test_session.h"

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

TEST(SurfacePoint, WhatIsNotFeltCannotBeTouched) {
  const Model model = testing::ball_model();
  const auto found = find_surface_point(model, testing::kFat, 5);
  ASSERT_FALSE(found.ok());
  EXPECT_NE(found.error().what.find("not felt"), std::string::npos);
}

}  // namespace
}  // namespace palpate
