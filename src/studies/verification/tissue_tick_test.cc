#include "verification/tissue_tick.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

// A part of the tests of the tick in `verify tissue`.
class TissueTick : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    nodule_ = block(true, TissueLaw::kElastic);
    plain_ = block(false, TissueLaw::kElastic);
  }
  static void TearDownTestSuite() {
    nodule_.reset();
    plain_.reset();
  }
  static std::shared_ptr<const Model> block(bool nodule, TissueLaw law) {
    auto made = soft_block(nodule, law);
    PALPATE_CHECK(made.ok());
    return *std::move(made);
  }

  static std::shared_ptr<const Model> nodule_, plain_;
};
std::shared_ptr<const Model> TissueTick::nodule_, TissueTick::plain_;

TEST_F(TissueTick, PressForceConvergesToTheSolution) {
  const TickError off = press_tissue(nodule_, 50, 0);
  EXPECT_GT(off.samples, 10);
  EXPECT_GT(off.peak_N, 0.2);
  EXPECT_LT(off.largest_percent, 6);
  EXPECT_LT(off.mean_percent, 1);
}

TEST_F(TissueTick, SlidingToolLocatesAnInclusion) {
  const TickError off = slide_on_tissue(nodule_, 50);
  EXPECT_GT(off.samples, 10);
  EXPECT_LT(off.largest_percent, 6);
}

TEST_F(TissueTick, NewFrameChangesNoForceAtRest) {
  EXPECT_LT(change_at_rest_N(nodule_), 1e-3);
}

TEST_F(TissueTick, NeoHookeanBodyStiffensAndConservesEnergy) {
  const auto nodule = block(true, TissueLaw::kNeoHookean), plain = block(false, TissueLaw::kNeoHookean);
  EXPECT_GT(over_nodule(nodule, plain, 3).stiffness_percent, 22);
  const TickError off = press_tissue(nodule, 20, 0);
  EXPECT_GT(off.samples, 10);
  EXPECT_LT(off.largest_percent, 10);
  EXPECT_LT(generated_work_percent(nodule, 20), 2);
}

TEST_F(TissueTick, OverSomethingHardItIsHarder) {
  const OverNodule over = over_nodule(nodule_, plain_, 3);
  EXPECT_GT(over.force_percent, 8);
  EXPECT_GT(over.stiffness_percent, over.force_percent);
}

TEST_F(TissueTick, RelaxedForceMatchesThePronySeries) {
  constexpr Relaxation kSeries{{{{0.5, 0.2}, {}}}};
  const auto elastic = soft_block(false), relaxing = soft_block(false, TissueLaw::kElastic, kSeries);
  ASSERT_TRUE(elastic.ok() && relaxing.ok());
  const RelaxationError off = press_relaxing(*relaxing, *elastic, kSeries, 1.2);
  EXPECT_GT(off.samples, 100);
  EXPECT_LT(off.pressed_percent, 1);
  EXPECT_LT(off.hold_percent, 1);
  EXPECT_NEAR(off.remaining_fraction, 0.5, 0.005);
}

}  // namespace
}  // namespace palpate
