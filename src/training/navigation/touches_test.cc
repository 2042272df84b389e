#include "palpate/navigation/touches.h"

#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"
#include "navigation/test_poses.h"

namespace palpate {
namespace {

using State = TouchDetector::State;

/// A tip tracked at 50 Hz.
class Touches : public ::testing::Test {
 protected:
  // holds the tip with a given tremor; returns the last state
  State hold(const Point<Tracker>& at, double seconds, double shake_mm = 0) {
    State last = State::kMoving;
    for (int n = 0; n < static_cast<int>(std::lround(50 * seconds)); ++n) {
      time_s_ += 0.02;
      last = taker_.observe(at + Vector<Tracker>(shake_mm * test::normal(random_)), time_s_);
      if (last == State::kTaken) return last;
    }
    return last;
  }
  std::mt19937 random_{test::test_seed()};
  TouchDetector taker_;
  double time_s_ = 0;
};

TEST_F(Touches, AreTakenWhereTheTipIsHeldForASecond) {
  EXPECT_EQ(hold({0, 0, 0}, 0.9), State::kHeld);
  EXPECT_EQ(hold({0, 0, 0}, 0.3), State::kTaken);
  ASSERT_EQ(taker_.taken().size(), 1u);
  // only after the tip has left
  EXPECT_EQ(hold({0, 0, 0}, 3), State::kTooNear);
  EXPECT_EQ(hold({4, 0, 0}, 3), State::kTooNear);
  EXPECT_EQ(hold({6, 0, 0}, 1.3), State::kTaken);
  // the approach to a point is excluded
  for (double x = 6; x < 100; x += 0.4) EXPECT_NE(hold({x, 0, 0}, 0.02), State::kTaken) << x;
  EXPECT_EQ(hold({100, 0, 0}, 1.3), State::kTaken);
  EXPECT_NEAR(taker_.taken().back().at.x(), 100, 0.2);
}

TEST_F(Touches, AverageTheirPosesAndReportTheSpread) {
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  ASSERT_EQ(hold({10, 20, 30}, 1.3, 0.1), State::kTaken);
  const TouchedPoint& point = taker_.taken().back();
  EXPECT_LT((point.at - Point<Tracker>(10, 20, 30)).norm(), 0.1);
  EXPECT_NEAR(point.spread_mm, 0.1 * std::sqrt(3), 0.05);
  EXPECT_NEAR(static_cast<double>(point.poses), 51, 1);
  // excessive tremor never counts as held
  EXPECT_EQ(hold({50, 0, 0}, 5, 1), State::kMoving);
}

// the tip may have moved while its markers were hidden
TEST_F(Touches, GapStartsANewTouch) {
  EXPECT_EQ(hold({0, 0, 0}, 0.9), State::kHeld);
  time_s_ += 0.5;
  EXPECT_EQ(hold({0, 0, 0}, 0.9), State::kHeld);
  EXPECT_EQ(hold({0, 0, 0}, 0.3), State::kTaken);
  taker_.undo();
  EXPECT_TRUE(taker_.taken().empty());
  EXPECT_EQ(hold({0, 0, 0}, 0.9), State::kHeld) << "the same place may be touched again";
  taker_.undo();
}

}  // namespace
}  // namespace palpate
