#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "haptics/test_model.h"
#include "palpate/servo.h"

namespace palpate {
namespace {

using testing::ball_model;
using testing::kBone;
using testing::kBoneRadius_mm;

constexpr double kTick_s = 1e-3;

// one device, ticked at chosen places
struct Loop {
  Model model = ball_model();
  Parameters parameters;
  SessionState state;
  TickRecord record;
  Wrench wrench;

  void at(const Point<World>& tip) {
    DeviceState device;
    device.tip = tip;
    tick(model, parameters, {&device, 1}, kTick_s, state, {&wrench, 1}, record);
  }
};

TEST(Tick, PushesOutAlongTheAnalyticNormalWithTheAnalyticForce) {
  Loop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.parameters.max_force_N = 100;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const Vector<World> n = Vector<World>(normal(random), normal(random), normal(random)).normalized();
    const double distance_mm = -0.6 + 0.006 * i;
    loop.at(Point<World>() + n * (kBoneRadius_mm + distance_mm));
    const double expected_N = loop.model.full_force_N * testing::ramp(distance_mm, 1.0);
    EXPECT_GT(loop.wrench.force_N.normalized().dot(n), std::cos(0.05))
        << "central differences over 0.9 mm of a 1 mm ramp, at " << distance_mm << " mm";
    EXPECT_NEAR(loop.wrench.force_N.norm(), expected_N, 0.06 * loop.model.full_force_N);
    EXPECT_EQ(loop.record.device[0].label, kBone);
    EXPECT_TRUE(loop.record.device[0].flags & kFlagContact);
  }
}

TEST(Tick, SlopeAtTheSurfaceIsTheTissuesStiffness) {
  Loop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.parameters.max_force_N = 100;
  loop.at(Point<World>(kBoneRadius_mm - 0.1, 0, 0));
  const double deeper_N = loop.wrench.force_N.x();
  loop.at(Point<World>(kBoneRadius_mm + 0.1, 0, 0));
  // trilinear interpolation flattens the ramp's steepest part a little
  EXPECT_NEAR((deeper_N - loop.wrench.force_N.x()) / 0.2, 1.5, 0.15);
}

TEST(Tick, ForceTurnsWithTheObject) {
  // the ball is made unequal by moving it off the pivot: what is felt must turn rigidly with it
  Loop still, turned;
  still.parameters.friction = still.parameters.viscosity = false;
  still.model.X_WorldPatient = Transform<World, Patient>(still.model.X_WorldPatient.linear(), {4, 1, -2});
  turned.parameters = still.parameters;
  turned.model.X_WorldPatient = still.model.X_WorldPatient;
  const auto R = Rotation<World, World>::about(Eigen::Vector3d(1, 2, -1).normalized(), 0.7);
  turned.parameters.rotation_target = R.quaternion();
  for (int n = 0; n < 150; ++n) turned.at(Point<World>(40, 0, 0));  // let the turn finish
  for (int i = 0; i < 50; ++i) {
    const Point<World> tip(4 + kBoneRadius_mm * std::cos(0.1 * i), 1 + kBoneRadius_mm * std::sin(0.1 * i),
                           -2 + 0.1 * i);
    still.at(tip);
    turned.at(Point<World>((R * Vector<World>(tip.eigen())).eigen()));
    EXPECT_LT((turned.wrench.force_N - R * still.wrench.force_N).norm(), 1e-9);
    EXPECT_NEAR(turned.record.device[0].depth_mm, still.record.device[0].depth_mm, 1e-9);
  }
}

TEST(Tick, ARotationCommandIsInterpolatedWithoutAStepOfForce) {
  Loop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  // off the pivot, so that turning moves the surface under the still tip
  loop.model.X_WorldPatient = Transform<World, Patient>(loop.model.X_WorldPatient.linear(), {10, 0, 0});
  const Point<World> tip(10, kBoneRadius_mm, 0);
  loop.at(tip);
  Vector<World> previous = loop.wrench.force_N;
  double largest_step_N = 0, total_N = 0;
  for (int command = 1; command <= 5; ++command) {
    loop.parameters.rotation_target =
        Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), -0.01 * command).quaternion();
    for (int n = 0; n < 100; ++n) {
      loop.at(tip);
      largest_step_N = std::max(largest_step_N, (loop.wrench.force_N - previous).norm());
      previous = loop.wrench.force_N;
    }
    total_N = std::max(total_N, (loop.wrench.force_N).norm());
  }
  EXPECT_LT(largest_step_N, 0.01) << "a command of 0.1 mm at 1.5 N/mm is spread over 100 ticks";
  const Eigen::Quaterniond felt = loop.state.rotation_felt, asked = loop.parameters.rotation_target;
  EXPECT_NEAR(felt.angularDistance(asked), 0, 1e-12) << "and arrives";
}

TEST(Tick, ACommandThatIsNoRotationIsIgnoredAndSaidSo) {
  Loop loop;
  const auto R = Rotation<World, World>::about(Eigen::Vector3d::UnitY(), 0.2);
  loop.parameters.rotation_target = R.quaternion();
  for (int n = 0; n < 150; ++n) loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_FALSE(loop.record.device[0].flags & kFlagRotationIgnored);
  for (const double w : {0.0, 1e-300, 1e200, HUGE_VAL, std::nan("")}) {
    loop.parameters.rotation_target = Eigen::Quaterniond(w, 0, 0, 0);
    for (int n = 0; n < 150; ++n) loop.at(Point<World>(kBoneRadius_mm, 0, 0));
    EXPECT_TRUE(loop.record.device[0].flags & kFlagRotationIgnored) << w;
    EXPECT_NEAR(loop.state.rotation_felt.angularDistance(R.quaternion()), 0, 1e-12) << w;
    EXPECT_GT(loop.wrench.force_N.norm(), 0.1) << "what is touched is still felt";
  }
}

TEST(Tick, DeepInsideIsAContactThoughNothingPushes) {
  Loop loop;
  for (int n = 0; n < 30; ++n) loop.at(Point<World>(0, 0, 0));
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  EXPECT_EQ(loop.record.device[0].label, kBone);
  EXPECT_TRUE(loop.record.device[0].flags & kFlagContact);
}

TEST(Tick, VelocityIsRelativeToTheObject) {
  // a tip that rides on the turning object does not move relative to it
  Loop loop;
  const auto turn_at = [](double t) {
    return Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), 0.5 * t);
  };
  double t = 0;
  for (int command = 0; command < 10; ++command) {
    loop.parameters.rotation_target = turn_at(t + 0.1).quaternion();
    for (int n = 0; n < 100; ++n) {
      t += kTick_s;
      loop.at(Point<World>((turn_at(t) * Vector<World>(0, kBoneRadius_mm, 0)).eigen()));
    }
  }
  const auto& v = loop.record.device[0].velocity_patient_mm_s;
  EXPECT_LT(std::hypot(v[0], v[1], v[2]), 1e-6) << "the tip itself moves at 7.5 mm/s";
}

TEST(Tick, NeverSendsMoreThanTheLimitAndSaysSo) {
  Loop loop;
  loop.parameters.max_force_N = 0.8;
  for (double x = 20; x > 5; x -= 0.05) {
    loop.at(Point<World>(x, 0.3, 0));
    ASSERT_LE(loop.wrench.force_N.norm(), 0.8);
    const bool above = loop.record.device[0].unclamped_force_N > 0.8;
    EXPECT_EQ((loop.record.device[0].flags & kFlagClamped) != 0, above);
  }
}

TEST(Tick, SurvivesPosesThatAreNotFinite) {
  Loop loop;
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    loop.at(Point<World>(0, bad, 0));
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
    EXPECT_TRUE(loop.record.device[0].flags & kFlagNotFinite);
  }
  // the velocity window starts anew: the jump back is no motion
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_GT(loop.wrench.force_N.norm(), 0.1);
  EXPECT_EQ(loop.record.device[0].velocity_patient_mm_s, (std::array<double, 3>{}));
}

TEST(Tick, OutsideTheVolumeIsFreeAndFlagged) {
  Loop loop;
  for (const Point<World>& tip :
       {Point<World>(35, 0, 0), Point<World>(0, -1e9, 0), Point<World>(0, 0, 1e300)}) {
    loop.at(tip);
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
    EXPECT_TRUE(loop.record.device[0].flags & kFlagOutside);
  }
}

TEST(Tick, ViscosityActsDeepInsideWhereTheNormalVanishes) {
  Loop loop;
  for (int n = 0; n < 30; ++n) loop.at(Point<World>(0.02 * n, 0, 0));
  EXPECT_EQ(loop.record.device[0].normal_patient, (std::array<double, 3>{}));
  // 20 mm/s through bone's viscosity
  EXPECT_NEAR(loop.wrench.force_N.x(), -20 * loop.model.tissues[0].viscosity_N_s_per_mm, 1e-6);
}

TEST(Tick, SeveralPointsGiveATorqueAboutTheTip) {
  Loop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.model.tool.points_mm = {{0, 0, 0}, {10, 0, 0}};
  DeviceState device;
  // the second point, turned towards +y, touches the ball's top; the tip hangs free
  device.tip = Point<World>(0, kBoneRadius_mm + 10, 0);
  device.R_WorldTool = Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitZ());
  tick(loop.model, loop.parameters, {&device, 1}, kTick_s, loop.state, {&loop.wrench, 1}, loop.record);
  EXPECT_GT(loop.wrench.force_N.y(), 0.5);
  const Vector<World> arm(0, -10, 0);
  EXPECT_LT((loop.wrench.torque_Nmm - arm.cross(loop.wrench.force_N)).norm(), 1e-9);
}

TEST(Tick, DevicesDoNotDisturbEachOther) {
  Loop alone;
  Loop both;
  std::array<DeviceState, 2> devices;
  std::array<Wrench, 2> wrenches;
  for (int n = 0; n < 50; ++n) {
    const Point<World> tip(kBoneRadius_mm, 0.05 * n, 0);
    alone.at(tip);
    devices[0].tip = Point<World>(-kBoneRadius_mm, 0, 0.1 * n);
    devices[1].tip = tip;
    tick(both.model, both.parameters, devices, kTick_s, both.state, wrenches, both.record);
    EXPECT_EQ(wrenches[1].force_N, alone.wrench.force_N);
  }
}

TEST(Tick, StateHashRepeatsAndSeesEveryInput) {
  const auto run = [](double nudge, bool friction) {
    Loop loop;
    loop.parameters.friction = friction;
    for (int n = 0; n < 40; ++n) loop.at(Point<World>(kBoneRadius_mm, 0.1 * n + (n == 20 ? nudge : 0), 0));
    return loop.record.state_hash;
  };
  EXPECT_EQ(run(0, true), run(0, true));
  EXPECT_NE(run(0, true), run(0, false));
  Loop a, b;
  a.at(Point<World>(1, 2, 3));
  b.at(Point<World>(1, 2, std::nextafter(3.0, 4.0)));
  EXPECT_NE(a.record.state_hash, b.record.state_hash);
}

TEST(Tick, RecordHoldsEveryInput) {
  Loop loop;
  loop.parameters.viscosity = false;
  loop.parameters.max_force_N = 1.25;
  loop.parameters.rotation_target = Rotation<World, World>::about(Eigen::Vector3d::UnitX(), 0.3).quaternion();
  loop.model.version = 9;
  DeviceState device;
  device.tip = Point<World>(1, 2, 3);
  device.R_WorldTool = Rotation<World, World>::about(Eigen::Vector3d::UnitY(), 0.1).quaternion();
  device.buttons = 5;
  tick(loop.model, loop.parameters, {&device, 1}, 2e-3, loop.state, {&loop.wrench, 1}, loop.record);
  EXPECT_EQ(loop.record.device[0].tip_world_mm, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(loop.record.device[0].orientation_wxyz[0], device.R_WorldTool.w());
  EXPECT_EQ(loop.record.device[0].buttons, 5u);
  EXPECT_EQ(loop.record.switches, kSwitchFriction);
  EXPECT_EQ(loop.record.max_force_N, 1.25);
  EXPECT_EQ(loop.record.dt_s, 2e-3);
  EXPECT_EQ(loop.record.model_version, 9u);
  EXPECT_EQ(loop.record.rotation_target_wxyz[1], loop.parameters.rotation_target.x());
}

}  // namespace
}  // namespace palpate
