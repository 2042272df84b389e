#include "palpate/tasks/burr_meters.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "loading/test_loading.h"

namespace palpate {
namespace {

// the ball of bone of 15 mm radius around the origin (contact/test_model.h), with a burr
class BurrMeters : public ::testing::Test {
 protected:
  BurrMeters() {
    std::vector<bool> ball(testing::kBone + 1u);
    ball[testing::kBone] = true;
    distances_ = std::make_shared<const std::vector<StructureDistance>>(
        structure_distances(*loaded_.model, {}, ball).value());
  }
  static Cut cut(const Point<Patient>& from, const Point<Patient>& to, double radius_mm) {
    return {0, {from, to, radius_mm}};
  }
  static ToolHead head_at(const Point<Patient>& at, double radius_mm = 2) {
    return {at, at, radius_mm, radius_mm};
  }

  LoadedScene loaded_ = testing::loaded_burr();
  const Model& model_ = *loaded_.model;
  StructureDistances distances_;
};

TEST_F(BurrMeters, RemainingBoneIsTheDistanceFromRemovalToSurface) {
  ASSERT_EQ(distances_->size(), 1u);
  const double radius_mm = -distances_->front().distance_mm({0, 0, 0});
  RemovedVolume removed(model_);
  EXPECT_TRUE(std::isnan(bone_left_mm(*distances_, removed))) << "nothing was removed";
  // the structure itself is cut: the greatest depth, at sample points 0.15 and 0.225 mm apart
  const std::vector<Cut> cuts{cut({0, 0, radius_mm + 1}, {0, 0, radius_mm + 1}, 4)};
  removed.add(cuts);
  EXPECT_NEAR(bone_left_mm(*distances_, removed), -3, 0.2);
}

// compared with the distance at every position of the head
TEST_F(BurrMeters, DistanceAndForceNearAreThoseOfEveryTick) {
  std::mt19937 random(test::test_seed());
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int walk = 0; walk < 20; ++walk) {
    const double within_mm = within(0, 6);
    BurrNearStructures meter(distances_, within_mm);
    Point<Patient> at(within(-5, 5), within(-5, 5), within(18, 26));
    double nearest_mm = std::numeric_limits<double>::infinity(), peak_N = 0;
    for (int n = 0; n < 400; ++n) {
      at = at + Vector<Patient>(within(-0.3, 0.3), within(-0.3, 0.3), within(-0.35, 0.3));
      const double force_N = within(0, 3), gap_mm = distances_->front().distance_mm(at) - 2;
      meter.observe(head_at(at), force_N);
      nearest_mm = std::min(nearest_mm, gap_mm);
      if (gap_mm <= within_mm) peak_N = std::max(peak_N, force_N);
    }
    EXPECT_NEAR(meter.nearest_mm(), nearest_mm, 1e-9);
    EXPECT_EQ(meter.peak_N(), peak_N);
  }
}

// A shaft of 3 mm radius is drilled into the ball along z, and a tunnel from its bottom along x. From above
// the bottom of the shaft is seen, and the tunnel as far as its roof allows at the microscope's tilt.
TEST_F(BurrMeters, MicroscopeSeesUncoveredHeads) {
  const double bottom_mm = 5;
  RemovedVolume removed(model_);
  const MicroscopeView view({.from = {0, 0, 1}, .tilt_deg = 20}, model_);
  EXPECT_TRUE(view.is_visible(head_at({0, 0, 30}), removed)) << "outside";
  EXPECT_FALSE(view.is_visible(head_at({0, 0, bottom_mm}), removed)) << "before it is drilled";
  const std::vector<Cut> cuts{cut({0, 0, 20}, {0, 0, bottom_mm}, 3),
                              cut({0, 0, bottom_mm}, {9, 0, bottom_mm}, 3)};
  removed.add(cuts);
  EXPECT_TRUE(view.is_visible(head_at({0, 0, bottom_mm}), removed));
  EXPECT_TRUE(view.is_visible(head_at({2, 0, bottom_mm}), removed));
  EXPECT_FALSE(view.is_visible(head_at({8, 0, bottom_mm}), removed)) << "below the roof of the tunnel";
  // seen along the tunnel's mouth once the microscope stands on that side
  const MicroscopeView beside({.from = {1, 0, 0}, .tilt_deg = 0}, model_);
  EXPECT_FALSE(beside.is_visible(head_at({0, 0, bottom_mm}), removed));
  const std::vector<Cut> through{cut({0, 0, bottom_mm}, {20, 0, bottom_mm}, 3)};
  removed.add(through);
  EXPECT_TRUE(beside.is_visible(head_at({0, 0, bottom_mm}), removed));
  ASSERT_TRUE(removed.undo());
}

TEST_F(BurrMeters, AWiderTiltSeesNoLess) {
  std::mt19937 random(test::test_seed());
  const auto within = [&](double largest) {
    return std::uniform_real_distribution<double>(-largest, largest)(random);
  };
  RemovedVolume removed(model_);
  const std::vector<Cut> cuts{cut({0, 0, 20}, {0, 0, 4}, 4)};
  removed.add(cuts);
  const MicroscopeView straight({.from = {0, 0, 1}, .tilt_deg = 0}, model_);
  const MicroscopeView tilted({.from = {0, 0, 1}, .tilt_deg = 30}, model_);
  int more = 0;
  for (int n = 0; n < 300; ++n) {
    const ToolHead head = head_at({within(9), within(9), 8 + within(8)}, 1);
    const bool is_seen = straight.is_visible(head, removed);
    EXPECT_TRUE(!is_seen || tilted.is_visible(head, removed));
    more += !is_seen && tilted.is_visible(head, removed);
  }
  EXPECT_GT(more, 0);
}

}  // namespace
}  // namespace palpate
