#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "contact/test_model.h"
#include "palpate/servo/servo.h"

/// Tests of a tool that the hand rotates, by the complete tick.
namespace palpate {
namespace {

using testing::kBoneRadius_mm;

constexpr double kToolLever_mm = 100;

// a ball, and a lever from the tip to a point above it; in World
struct TurnedLoop {
  Model model = testing::with_exact_surfaces(testing::ball_model());
  Parameters parameters;
  SessionState state;
  TickRecord record;
  Wrench wrench;
  double tick_s = 4e-3;

  TurnedLoop() {
    state.device[0].output.gain = 1;
    parameters.method = ForceMethod::kProxy;
    parameters.passivity = parameters.friction = parameters.viscosity = false;
    parameters.max_force_N = 1000;
    parameters.device[0].limits.slew_N_per_s = std::numeric_limits<double>::infinity();
    parameters.device[0].limits.peak_torque_Nmm = 1e6;
    model.tools[0].points_mm = {{-kToolLever_mm, 0, 0}};
  }
  // rotated so that the lever's end moves down
  void at(const Point<World>& tip, double angle_rad) {
    DeviceState device;
    device.tip = tip;
    device.R_WorldTool = Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitZ());
    tick(model, parameters, {&device, 1}, tick_s, state, {&wrench, 1}, record);
  }
};

TEST(ToolTurnTick, LeverRotatedIntoABallIsConstrained) {
  // 20 rad/s at 250 Hz: 8 mm per tick, until the lever's end is 11 mm deep by the hand's attitude
  TurnedLoop loop;
  const Point<World> tip(kToolLever_mm, kBoneRadius_mm + 5, 0);
  const double end_rad = std::asin((5 + 11) / kToolLever_mm);
  for (double angle = 0; angle < end_rad; angle += 20 * loop.tick_s) loop.at(tip, angle);
  for (int n = 0; n < 40; ++n) loop.at(tip, end_rad);
  EXPECT_TRUE(loop.record.device[0].flags & kFlagContact);
  EXPECT_FALSE(loop.record.device[0].flags & kFlagWedged);
  // 1.5 N/mm along the way out, and the torque about the tip
  EXPECT_NEAR(loop.wrench.force_N.norm(), 1.5 * (kBoneRadius_mm - std::hypot(4, 1.29)), 0.3);
  EXPECT_GT(loop.wrench.force_N.normalized().y(), 0.9);
  const Vector<World> lever =
      Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), end_rad) * Vector<World>(-kToolLever_mm, 0, 0);
  EXPECT_LT((loop.wrench.torque_Nmm - lever.cross(loop.wrench.force_N)).norm(),
            1e-3 * loop.wrench.torque_Nmm.norm());
}

TEST(ToolTurnTick, HashCoversTheAttitude) {
  // in free air, where a rotation changes nothing else
  const auto hash_of = [](double angle_rad) {
    TurnedLoop loop;
    for (int n = 0; n < 20; ++n) loop.at(Point<World>(0, 400, 0), angle_rad);
    return loop.record.state_hash;
  };
  EXPECT_EQ(hash_of(0.3), hash_of(0.3));
  EXPECT_NE(hash_of(0.3), hash_of(0.31));
}

TEST(ToolTurnTick, EditKeepsTheAttitudeOfARotatedTool) {
  TurnedLoop loop;
  loop.tick_s = 1e-3;
  const Point<World> tip(kToolLever_mm, kBoneRadius_mm + 1, 0);
  for (double angle = 0; angle < 0.02; angle += 1e-3) loop.at(tip, angle);
  for (int n = 0; n < 40; ++n) loop.at(tip, 0.02);
  const Vector<World> before_N = loop.wrench.force_N;
  ASSERT_GT(before_N.y(), 1);
  loop.model.version = 2;
  loop.at(tip, 0.02);
  EXPECT_FALSE(loop.record.device[0].flags & kFlagInside);
  EXPECT_LT((loop.wrench.force_N - before_N).norm(), 1e-6);
}

}  // namespace
}  // namespace palpate
