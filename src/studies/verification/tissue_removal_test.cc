#include "verification/tissue_removal.h"

#include <gtest/gtest.h>

#include "verification/tissue_tick.h"

namespace palpate {
namespace {

// A part of the tests of cut tissue in `verify tissue`.
TEST(TissueRemoval, SolutionFollowsTheRemoval) {
  const auto model = soft_block(false);
  ASSERT_TRUE(model.ok());
  const CutTissue milled = mill_nearby(**model, 40);
  EXPECT_GT(milled.frames, 25u);
  EXPECT_LT(milled.lag_percent, 0.1);
  EXPECT_LT(milled.change_percent, 1.5);
  EXPECT_LT(milled.force_changed_percent, -4);
}

TEST(TissueRemoval, RebuildingTheBoxBarelyChangesTheForce) {
  const auto model = soft_block(false);
  ASSERT_TRUE(model.ok());
  const Recentring slid = slide_through_boxes(**model, 50);
  EXPECT_GE(slid.boxes, 3u);
  EXPECT_LT(slid.change_percent, 2.5);
}

}  // namespace
}  // namespace palpate
