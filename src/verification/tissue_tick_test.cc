#include "verification/tissue_tick.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

// What `verify tissue` says of the tick, a part of it.
class TissueTick : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    auto with = yielding_block(true);
    PALPATE_CHECK(with.ok());
    nodule_ = *std::move(with);
  }
  static void TearDownTestSuite() { nodule_.reset(); }

  static std::shared_ptr<const Model> nodule_;
};
std::shared_ptr<const Model> TissueTick::nodule_;

TEST_F(TissueTick, AToolThatPressesFeelsWhatASolutionGivesInTheEnd) {
  const TickOff off = press_tissue(nodule_, 50, 0);
  EXPECT_GT(off.samples, 10);
  EXPECT_GT(off.peak_N, 0.2);
  EXPECT_LT(off.largest_percent, 6);
  EXPECT_LT(off.mean_percent, 1);
}

TEST_F(TissueTick, AToolThatSlidesOverSomethingHardFeelsItWhereItIs) {
  const TickOff off = slide_on_tissue(nodule_, 50);
  EXPECT_GT(off.samples, 10);
  EXPECT_LT(off.largest_percent, 6);
}

TEST_F(TissueTick, AtRestAFrameIsNotFelt) {
  EXPECT_LT(change_at_rest_N(nodule_), 1e-3);
}

TEST_F(TissueTick, OverSomethingHardItIsHarder) {
  EXPECT_GT(stiffer_over_nodule_percent(nodule_, 3), 8);
}

TEST_F(TissueTick, WhatRelaxesIsWhatItsSeriesLeavesOfTheSameTissue) {
  constexpr Relaxation kSeries{{{{0.5, 0.2}, {}}}};
  const auto elastic = yielding_block(false), relaxing = yielding_block(false, kSeries);
  ASSERT_TRUE(elastic.ok() && relaxing.ok());
  const RelaxedOff off = press_relaxing(*relaxing, *elastic, kSeries, 1.2);
  EXPECT_GT(off.samples, 100);
  EXPECT_LT(off.pressed_percent, 1);
  EXPECT_LT(off.held_percent, 1);
  EXPECT_NEAR(off.left, 0.5, 0.005);
}

}  // namespace
}  // namespace palpate
