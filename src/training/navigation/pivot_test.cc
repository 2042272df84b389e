#include "palpate/navigation/pivot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "navigation/test_poses.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using Pose = Transform<Tracker, TrackedTool>;

const Point<TrackedTool> kTip(-17.8, 1.1, -156.9);
const Point<Tracker> kPivot(146.9, -63, -1042.1);

// the tool is rotated by angles of these standard deviations about its axes, one after the other
std::vector<Pose> swing(std::mt19937& random, int count, const Eigen::Vector3d& deviations_deg,
                        double noise_mm) {
  std::vector<Pose> poses;
  const Rotation<Tracker, TrackedTool> upright(test::any_rotation(random));
  for (int n = 0; n < count; ++n) {
    const Eigen::Vector3d angles = test::normal(random).cwiseProduct(deviations_deg) * std::numbers::pi / 180;
    Eigen::Quaterniond turned = Eigen::Quaterniond::Identity();
    for (int k = 0; k < 3; ++k) turned = turned * Eigen::AngleAxisd(angles[k], Eigen::Vector3d::Unit(k));
    const Rotation<Tracker, TrackedTool> rotation = upright * Rotation<TrackedTool, TrackedTool>(turned);
    const Vector<Tracker> to_tip = rotation * (kTip - Point<TrackedTool>());
    poses.emplace_back(rotation,
                       kPivot - Point<Tracker>() - to_tip + Vector<Tracker>(noise_mm * test::normal(random)));
  }
  return poses;
}

TEST(Pivot, FindsTipAndPivot) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  const auto found = calibrate_pivot(swing(random, 40, {20, 20, 20}, 0));
  ASSERT_TRUE(found) << found.error().message();
  EXPECT_LT((found->tip - kTip).norm(), 1e-6);
  EXPECT_LT((found->pivot - kPivot).norm(), 1e-6);
  EXPECT_EQ(found->used, 40);
}

// the predicted error of the tip is the actual one
TEST(Pivot, ItsErrorIsAsForetold) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  double squares = 0, predicted = 0;
  constexpr int kRuns = 300;
  for (int run = 0; run < kRuns; ++run) {
    const auto found = calibrate_pivot(swing(random, 60, {20, 20, 20}, 0.3));
    ASSERT_TRUE(found) << found.error().message();
    squares += (found->tip - kTip).squared_norm();
    predicted += found->tip_error_mm * found->tip_error_mm;
  }
  EXPECT_NEAR(std::sqrt(squares / predicted), 1, 0.1);
}

// a tenth of the poses are wrong, as with partly occluded markers or a tip that slipped
TEST(Pivot, OutliersDoNotMoveIt) {
  std::mt19937 random(test::test_seed());
  for (int run = 0; run < 20; ++run) {
    SCOPED_TRACE("seed " + std::to_string(test::test_seed()) + ", run " + std::to_string(run));
    auto poses = swing(random, 200, {20, 20, 20}, 0.1);
    const auto without = calibrate_pivot(poses);
    ASSERT_TRUE(without);
    for (int n = 0; n < 20; ++n) {
      Pose& pose = poses[static_cast<std::size_t>(10 * n)];
      // from slightly off to far away, some all to one side
      pose = {pose.linear(),
              pose.translation() + (n % 2 ? Eigen::Vector3d(3, 0, 0) : (1.5 + n) * test::normal(random))};
    }
    const auto found = calibrate_pivot(poses);
    ASSERT_TRUE(found) << found.error().message();
    EXPECT_LT((found->tip - without->tip).norm(), 0.1);
    EXPECT_LT((found->tip - kTip).norm(), 0.15);
    int marked = 0;
    for (int n = 0; n < 20; ++n) marked += found->is_outlier[static_cast<std::size_t>(10 * n)];
    EXPECT_GE(marked, 17);
    EXPECT_GT(found->used, 170);
  }
}

TEST(Pivot, RejectsUndeterminedPoses) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  const auto refused = [](const std::vector<Pose>& poses) {
    const auto found = calibrate_pivot(poses);
    return found ? std::string("accepted") : found.error().message();
  };
  EXPECT_THAT(refused(swing(random, 5, {20, 20, 20}, 0)), HasSubstr("6 poses at least, but there are 5"));
  // a stationary tool, whose noise must not be taken for motion
  EXPECT_THAT(refused(swing(random, 100, {0, 0, 0}, 0.3)), HasSubstr("hardly turned"));
  EXPECT_THAT(refused(swing(random, 100, {1, 1, 1}, 0.3)), HasSubstr("hardly turned"));
  // rotation about a single axis: the tip's position along it is undetermined
  EXPECT_THAT(refused(swing(random, 100, {0, 30, 0}, 0.3)), HasSubstr("hardly turned"));
  EXPECT_EQ(refused(swing(random, 100, {20, 20, 0}, 0.3)), "accepted");
  auto sheared = swing(random, 10, {20, 20, 20}, 0);
  sheared[3] = {2 * sheared[3].linear(), sheared[3].translation()};
  EXPECT_THAT(refused(sheared), HasSubstr("pose 4 is not a rigid transform"));
}

}  // namespace
}  // namespace palpate
