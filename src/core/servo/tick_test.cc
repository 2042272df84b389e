#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "servo/test_ticked_loop.h"

namespace palpate {
namespace {

using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;
using testing::kMillisecond_s;
using testing::ProxyLoop;
using testing::TickedLoop;

TEST(Tick, PushesOutAlongTheAnalyticNormalWithTheAnalyticForce) {
  TickedLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.parameters.max_force_N = 100;
  const double full_N = loop.model.methods[0]->full_force_N();
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const Vector<World> n = Vector<World>(normal(random), normal(random), normal(random)).normalized();
    const double distance_mm = -0.6 + 0.006 * i;
    loop.set_down_at(Point<World>() + n * (kBoneRadius_mm + distance_mm));
    const double expected_N = full_N * testing::ramp(distance_mm, 1.0);
    EXPECT_GT(loop.wrench.force_N.normalized().dot(n), std::cos(0.05))
        << "central differences over 0.9 mm of a 1 mm ramp, at " << distance_mm << " mm";
    EXPECT_NEAR(loop.wrench.force_N.norm(), expected_N, 0.06 * full_N);
    EXPECT_EQ(loop.record.device[0].label, kBone);
    EXPECT_TRUE(loop.record.device[0].flags & kFlagContact);
  }
}

TEST(Tick, ForceSlopeAtTheSurfaceEqualsTissueStiffness) {
  TickedLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.parameters.max_force_N = 100;
  loop.at(Point<World>(kBoneRadius_mm - 0.1, 0, 0));
  const double deeper_N = loop.wrench.force_N.x();
  loop.at(Point<World>(kBoneRadius_mm + 0.1, 0, 0));
  // trilinear interpolation flattens the ramp's steepest part a little
  EXPECT_NEAR((deeper_N - loop.wrench.force_N.x()) / 0.2, 1.5, 0.15);
}

TEST(Tick, ForceRotatesWithTheObject) {
  // the ball is displaced from the pivot to break the symmetry: the contact must rotate rigidly with it
  TickedLoop still, turned;
  still.parameters.friction = still.parameters.viscosity = false;
  still.model.X_WorldPatient = Transform<World, Patient>(still.model.X_WorldPatient.linear(), {4, 1, -2});
  turned.parameters = still.parameters;
  turned.model.X_WorldPatient = still.model.X_WorldPatient;
  const auto R = Rotation<World, World>::about(Eigen::Vector3d(1, 2, -1).normalized(), 0.7);
  turned.parameters.rotation_target = R.quaternion();
  for (int n = 0; n < 400; ++n) turned.at(Point<World>(40, 0, 0));  // until the rotation is complete
  for (int i = 0; i < 50; ++i) {
    const Point<World> tip(4 + kBoneRadius_mm * std::cos(0.1 * i), 1 + kBoneRadius_mm * std::sin(0.1 * i),
                           -2 + 0.1 * i);
    still.set_down_at(tip);
    turned.set_down_at(Point<World>((R * Vector<World>(tip.eigen())).eigen()));
    EXPECT_LT((turned.wrench.force_N - R * still.wrench.force_N).norm(), 1e-9);
    EXPECT_NEAR(turned.record.device[0].depth_mm, still.record.device[0].depth_mm, 1e-9);
  }
}

TEST(Tick, RotationCommandCausesNoForceStep) {
  TickedLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  // displaced from the pivot, so that a rotation moves the surface under the stationary tip
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
  const Eigen::Quaterniond rotation = loop.state.rotation_applied,
                           requested = loop.parameters.rotation_target;
  EXPECT_NEAR(rotation.angularDistance(requested), 0, 1e-12) << "and arrives";
}

TEST(Tick, InvalidRotationCommandIsIgnoredAndFlagged) {
  TickedLoop loop;
  const auto R = Rotation<World, World>::about(Eigen::Vector3d::UnitY(), 0.2);
  loop.parameters.rotation_target = R.quaternion();
  for (int n = 0; n < 150; ++n) loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_FALSE(loop.record.device[0].flags & kFlagRotationIgnored);
  for (const double w : {0.0, 1e-300, 1e200, HUGE_VAL, std::nan("")}) {
    loop.parameters.rotation_target = Eigen::Quaterniond(w, 0, 0, 0);
    for (int n = 0; n < 150; ++n) loop.at(Point<World>(kBoneRadius_mm, 0, 0));
    EXPECT_TRUE(loop.record.device[0].flags & kFlagRotationIgnored) << w;
    EXPECT_NEAR(loop.state.rotation_applied.angularDistance(R.quaternion()), 0, 1e-12) << w;
    EXPECT_GT(loop.wrench.force_N.norm(), 0.1) << "what is touched is still felt";
  }
}

TEST(Tick, DeepInsideCountsAsContactWithoutForce) {
  TickedLoop loop;
  for (int n = 0; n < 30; ++n) loop.at(Point<World>(0, 0, 0));
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  EXPECT_EQ(loop.record.device[0].label, kBone);
  EXPECT_TRUE(loop.record.device[0].flags & kFlagContact);
}

TEST(Tick, VelocityIsRelativeToTheObject) {
  // a tip that moves with the turning object does not move relative to it
  TickedLoop loop;
  const auto turn_at = [](double t) {
    return Rotation<World, World>::about(Eigen::Vector3d::UnitZ(), 0.5 * t);
  };
  double t = 0;
  for (int command = 0; command < 10; ++command) {
    loop.parameters.rotation_target = turn_at(t + 0.1).quaternion();
    for (int n = 0; n < 100; ++n) {
      t += kMillisecond_s;
      loop.at(Point<World>((turn_at(t) * Vector<World>(0, kBoneRadius_mm, 0)).eigen()));
    }
  }
  const auto& v = loop.record.device[0].velocity_patient_mm_s;
  EXPECT_LT(std::hypot(v[0], v[1], v[2]), 1e-6) << "the tip itself moves at 7.5 mm/s";
}

TEST(Tick, ForceIsClampedToTheLimitAndFlagged) {
  TickedLoop loop;
  loop.parameters.max_force_N = 0.8;
  for (double x = 20; x > 5; x -= 0.05) {
    loop.at(Point<World>(x, 0.3, 0));
    ASSERT_LE(loop.wrench.force_N.norm(), 0.8);
    const bool above = loop.record.device[0].unclamped_force_N > 0.8;
    EXPECT_EQ((loop.record.device[0].flags & kFlagClamped) != 0, above);
  }
}

TEST(Tick, NonFinitePosesGiveZeroForce) {
  TickedLoop loop;
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    loop.at(Point<World>(0, bad, 0));
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
    EXPECT_TRUE(loop.record.device[0].flags & kFlagNotFinite);
  }
  // the velocity window is reset: the jump back is not motion; the force ramps in
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_EQ(loop.record.device[0].velocity_patient_mm_s, (std::array<double, 3>{}));
  EXPECT_TRUE(loop.record.device[0].flags & kFlagRamp);
  for (int n = 0; n < 600; ++n) loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_GT(loop.wrench.force_N.norm(), 0.1);
}

TEST(Tick, JumpZeroesTheForceThenRampsIn) {
  TickedLoop loop;
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_GT(loop.wrench.force_N.norm(), 0.1);
  loop.at(Point<World>(kBoneRadius_mm - 10.1, 0, 0));
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  EXPECT_TRUE(loop.record.device[0].flags & kFlagJump);
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  loop.at(Point<World>(kBoneRadius_mm, 0, 0));
  EXPECT_FALSE(loop.record.device[0].flags & kFlagJump);
  EXPECT_LT(loop.wrench.force_N.norm(), 0.01);
  EXPECT_EQ(loop.record.device[0].velocity_patient_mm_s, (std::array<double, 3>{})) << "no speed of 10 m/s";
  // the threshold applies to the device's displacement: 4 mm at scale 4 are 16 mm in the patient
  loop.parameters.device[0].scale = 4;
  loop.set_down_at(Point<World>(kBoneRadius_mm, 0, 0));
  loop.at(Point<World>(kBoneRadius_mm + 16, 0, 0));
  EXPECT_FALSE(loop.record.device[0].flags & kFlagJump);
  loop.at(Point<World>(kBoneRadius_mm + 57, 0, 0));
  EXPECT_TRUE(loop.record.device[0].flags & kFlagJump);
  loop.parameters.device[0].scale = 1;
  loop.set_down_at(Point<World>(kBoneRadius_mm, 0, 0));
  // the fastest hand motion is not a jump
  for (int n = 0; n < 40; ++n) {
    loop.at(Point<World>(kBoneRadius_mm + 3 * n, 0, 0));
    EXPECT_FALSE(loop.record.device[0].flags & kFlagJump) << n;
  }
}

TEST(Tick, PauseFadesOutAndBackIn) {
  TickedLoop loop;
  const Point<World> tip(kBoneRadius_mm, 0, 0);
  loop.at(tip);
  const double full_N = loop.wrench.force_N.norm();
  double previous_N = full_N;
  loop.parameters.paused = true;
  for (int n = 0; n < 150; ++n) {
    loop.at(tip);
    EXPECT_TRUE(loop.record.device[0].flags & kFlagPaused);
    EXPECT_NEAR(loop.wrench.force_N.norm(), previous_N, 0.0101 * full_N) << "no step";
    previous_N = loop.wrench.force_N.norm();
  }
  EXPECT_EQ(previous_N, 0);
  loop.parameters.paused = false;
  for (int n = 0; n < 510; ++n) {
    loop.at(tip);
    EXPECT_NEAR(loop.wrench.force_N.norm(), previous_N, 0.0021 * full_N) << "no step";
    previous_N = loop.wrench.force_N.norm();
  }
  EXPECT_NEAR(previous_N, full_N, 1e-12);
}

TEST(Tick, NonFiniteForceDoesNotPersistInTheState) {
  TickedLoop loop;
  const Point<World> tip(kBoneRadius_mm, 0, 0);
  loop.at(tip);
  const double full_N = loop.model.methods[0]->full_force_N();
  testing::set_full_force(loop.model, std::nan(""));
  loop.at(tip);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  // a new version repairs the model: a blend that starts from a non-finite force would stay non-finite
  testing::set_full_force(loop.model, full_N);
  ++loop.model.version;
  loop.at(tip);
  EXPECT_FALSE(loop.record.device[0].flags & kFlagNotFinite);
}

TEST(Tick, EmergencyStopAndStatusFaultsZeroTheForceAtOnce) {
  TickedLoop loop;
  DeviceState device;
  device.tip = Point<World>(kBoneRadius_mm, 0, 0);
  const auto expect_off = [&](std::uint32_t flag) {
    loop.at(device);
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
    EXPECT_TRUE(loop.record.device[0].flags & flag);
    loop.state.device[0].output.gain = 1;
  };
  loop.at(device);
  ASSERT_GT(loop.wrench.force_N.norm(), 0.1);
  loop.parameters.emergency_stop = true;
  expect_off(kFlagEmergencyStop);
  EXPECT_TRUE(loop.record.switches & kSwitchEmergencyStop);
  loop.parameters.emergency_stop = false;
  device.status = kDeviceFault;
  expect_off(kFlagDeviceFault);
  device.status = kDeviceHalted;
  expect_off(kFlagHalted);
  device.status = 0;
  device.age_s = 0.02;
  expect_off(kFlagStale);
}

TEST(Tick, GainsScaleTheForceBeforeTheLimit) {
  TickedLoop one, two;
  one.parameters.max_force_N = two.parameters.max_force_N = 2;
  two.parameters.device[0].force_gain = 2;
  two.parameters.device[0].scale = 4;
  one.model.tools[0].points_mm = two.model.tools[0].points_mm = {{0, 3, 0}};
  one.at(Point<World>(kBoneRadius_mm, -3, 0));
  two.at(Point<World>(kBoneRadius_mm, -3, 0));
  ASSERT_GT(one.wrench.torque_Nmm.norm(), 0.1);
  // the output stage clamps force and torque by the same factor
  const double clamp = std::min(1.0, 2 / two.record.device[0].unclamped_force_N);
  EXPECT_NEAR(two.record.device[0].unclamped_force_N, 2 * one.record.device[0].unclamped_force_N, 1e-12);
  EXPECT_LT((two.wrench.force_N - one.wrench.force_N * 2 * clamp).norm(), 1e-9);
  EXPECT_LT((two.wrench.torque_Nmm - one.wrench.torque_Nmm * (2.0 / 4) * clamp).norm(), 1e-9);
}

TEST(Tick, ProxyRendersTheTissueStiffness) {
  ProxyLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.lead({kBoneRadius_mm + 3, 0, 0}, {kBoneRadius_mm - 2, 0, 0}, 100);
  const DeviceTick& device = loop.record.device[0];
  EXPECT_NEAR(loop.wrench.force_N.x(), 2 * 1.5, 0.03);
  EXPECT_LT(std::hypot(loop.wrench.force_N.y(), loop.wrench.force_N.z()), 0.05);
  EXPECT_EQ(device.label, kBone);
  EXPECT_TRUE(device.flags & kFlagContact);
  EXPECT_EQ(device.flags & (kFlagInside | kFlagWedged | kFlagMethodMissing), 0u);
  EXPECT_NEAR(device.depth_mm, 2, 0.02);
  const auto& proxy = device.proxy_patient_mm;
  EXPECT_NEAR(Vector<Patient>(proxy[0], proxy[1], proxy[2]).norm(), kBoneRadius_mm, 0.03);
}

TEST(Tick, RecordedNormalIsWithinTheFrictionConeOfTheForce) {
  // Terraces of 0.7 mm with the normals of the slope, as smoothed normals are: the proxy rests on the
  // terraces' edges. And a notch between two walls.
  const auto slope_mm = [](const Eigen::Vector3d& p) {
    return (p.z() - 0.0875 * p.x()) / std::hypot(1, 0.0875);
  };
  const auto terraces_mm = [](const Eigen::Vector3d& p) {
    const double at = 0.0875 * p.x() / 0.7;
    return 0.9 * (p.z() - 0.7 * (std::floor(at) + std::clamp(8 * (at - std::floor(at)) - 3.5, 0.0, 1.0)));
  };
  const auto notch_mm = [](const Eigen::Vector3d& p) {
    return std::max(p.z() - std::abs(p.x()), -30.0) / std::sqrt(2.0);
  };
  for (const double coefficient : {0.0, 0.025, 0.3})
    for (const bool notch : {false, true}) {
      SCOPED_TRACE(std::to_string(coefficient) + (notch ? ", notch" : ", terraces"));
      ProxyLoop loop;
      loop.parameters.viscosity = false;
      loop.parameters.friction = coefficient > 0;
      const GridGeometry& grid = loop.model.labels->geometry();
      const auto position = notch ? testing::sampled_distance(grid, notch_mm, 4)
                                  : testing::sampled_distance(grid, terraces_mm, 4);
      const auto normals = notch ? position : testing::sampled_distance(grid, slope_mm, 4);
      loop.model.surfaces = {
          {{1.5, coefficient, coefficient},
           std::make_shared<const Surface>(position, normals, testing::steepest_of(position))}};
      loop.model.label_of_surface = {kBone};
      const auto at = [&](double x, double y, double z) {
        DeviceState device;
        device.tip = loop.model.X_WorldPatient * Point<Patient>(x, y, z);
        loop.at(device);
      };
      at(-6, 0, 3);
      for (int n = 0; n < 400; ++n) at(-6, 0, 3 - 0.01 * n);
      double farthest = 0;
      for (int n = 0; n < 12'000; ++n) {
        const double x = -6 + 0.001 * n;
        at(x, 0.5 * std::sin(0.003 * n), (notch ? std::abs(x) : 0.0875 * x) - 1);
        const auto& observed = loop.record.device[0];
        const Vector<Patient> normal(observed.normal_patient[0], observed.normal_patient[1],
                                     observed.normal_patient[2]);
        const Vector<Patient> force = loop.model.X_WorldPatient.inverse() * loop.wrench.force_N;
        if (force.norm() < 0.1) continue;
        ASSERT_NEAR(normal.norm(), 1, 1e-9);
        farthest = std::max(farthest, force.cross(normal).norm() / force.dot(normal));
        ASSERT_GT(force.dot(normal), 0);
      }
      EXPECT_LT(farthest, coefficient + 0.001) << "tangential over normal force";
    }
}

TEST(Tick, ProxyReportsTheLabelUnderTheContact) {
  ProxyLoop loop(3);
  loop.lead({kBoneRadius_mm + 6, 0, 0}, {kBoneRadius_mm + 2, 0, 0}, 100);
  EXPECT_EQ(loop.record.device[0].label, kCartilage);
  EXPECT_NEAR(loop.wrench.force_N.x(), 1 * 0.75, 0.05) << "cartilage's own stiffness";
}

TEST(Tick, ProxyReportsTheStructureOfADisplacedSurface) {
  // Model of bone bordering a skin that can be punctured: its surface in the outer layer follows the
  // structures' surfaces. Where it was smoothed there may be no felt voxel under it.
  ProxyLoop loop;
  ContactSurface outer = loop.model.surfaces[0];
  outer.structure = 0;
  loop.model.surfaces[0].surface = nullptr;
  loop.model.surfaces.push_back(outer);
  loop.model.labels = label_bricks(Volume<LabelId>(loop.model.labels->geometry()));
  ASSERT_EQ(loop.model.label_of_surface.size(), 1u);
  loop.lead({kBoneRadius_mm + 6, 0, 0}, {kBoneRadius_mm - 0.5, 0, 0}, 100);
  EXPECT_GT(loop.wrench.force_N.x(), 0.3);
  EXPECT_EQ(loop.record.device[0].label, kBone);
}

TEST(Tick, ReportsTheStructuresAlongThePenetrationPath) {
  ProxyLoop loop(3);
  const DeviceTick& device = loop.record.device[0];
  loop.lead({kBoneRadius_mm + 6, 0, 0}, {kBoneRadius_mm + 4, 0, 0}, 100);
  EXPECT_EQ(device.path_label[0], 0) << "nothing is touched";
  loop.lead({kBoneRadius_mm + 4, 0, 0}, {kBoneRadius_mm + 2, 0, 0}, 100);
  EXPECT_EQ(device.path_label[0], kCartilage);
  EXPECT_NEAR(device.path_depth_mm[0], 1, 0.02);
  EXPECT_NEAR(device.path_share[0], 1, 1e-12);
  EXPECT_EQ(device.path_label[1], 0);
  // by a direct method the touched structure accounts for the whole force
  loop.parameters.method = ForceMethod::kTrilinear;
  loop.at({kBoneRadius_mm + 2, 0, 0});
  EXPECT_EQ(device.path_label[0], device.label);
  EXPECT_EQ(device.path_depth_mm[0], device.depth_mm);
  EXPECT_EQ(device.path_share[0], 1);
}

TEST(Tick, ProxyIsUncoupledForATipInsideAtStartOrAfterAPause) {
  ProxyLoop loop;
  loop.at({kBoneRadius_mm - 1, 0, 0});
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
  loop.lead({kBoneRadius_mm - 1, 0, 0}, {kBoneRadius_mm + 1, 0, 0}, 50);
  EXPECT_FALSE(loop.record.device[0].flags & kFlagInside);
  loop.lead({kBoneRadius_mm + 1, 0, 0}, {kBoneRadius_mm - 1, 0, 0}, 50);
  EXPECT_GT(loop.wrench.force_N.x(), 1);
  // paused in contact: the surface point of first contact is forgotten
  loop.parameters.paused = true;
  for (int n = 0; n < 300; ++n) loop.at({kBoneRadius_mm - 1, 0, 0});
  loop.parameters.paused = false;
  for (int n = 0; n < 600; ++n) loop.at({kBoneRadius_mm - 1, 0, 0});
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
}

TEST(Tick, SetDownTipHasNoContactJumpOrForceRamp) {
  // within and beyond the displacement of a jump; on the far side of the ball, where no proxy could follow
  for (const double x_mm : {kBoneRadius_mm + 7, -kBoneRadius_mm - 3}) {
    for (const bool set_down : {true, false}) {
      SCOPED_TRACE(::testing::Message() << x_mm << " mm, set down " << set_down);
      ProxyLoop loop;
      loop.lead({kBoneRadius_mm + 3, 0, 0}, {kBoneRadius_mm - 2, 0, 0}, 100);
      ASSERT_TRUE(loop.record.device[0].flags & kFlagContact);
      DeviceState device;
      device.tip = {x_mm, 0, 0};
      device.status = set_down ? std::uint32_t{kDeviceSetDown} : 0u;
      loop.at(device);
      const DeviceTick& tick = loop.record.device[0];
      EXPECT_EQ((tick.flags & kFlagJump) != 0, !set_down && x_mm < 0);
      if (!set_down) continue;
      EXPECT_EQ(tick.flags & (kFlagContact | kFlagInside | kFlagRamp), 0u);
      EXPECT_EQ(loop.wrench.force_N, Vector<World>());
      EXPECT_NEAR(tick.proxy_patient_mm[0], x_mm, 1e-9);
      EXPECT_EQ(tick.velocity_patient_mm_s, (std::array<double, 3>{}));
      loop.lead({x_mm, 0, 0}, {std::copysign(kBoneRadius_mm - 1, x_mm), 0, 0}, 100);
      EXPECT_GT(std::copysign(1.0, x_mm) * loop.wrench.force_N.x(), 1);
      EXPECT_EQ(tick.flags & kFlagRamp, 0u);
    }
  }
  // inside of the ball the side of the surface is unknown
  ProxyLoop loop;
  loop.lead({kBoneRadius_mm + 3, 0, 0}, {kBoneRadius_mm - 2, 0, 0}, 100);
  DeviceState device;
  device.tip = {kBoneRadius_mm - 2, 0, 0};
  device.status = kDeviceSetDown;
  loop.at(device);
  EXPECT_TRUE(loop.record.device[0].flags & kFlagInside);
  EXPECT_EQ(loop.wrench.force_N, Vector<World>());
}

TEST(Tick, ProxySticksToARotatingObject) {
  ProxyLoop loop;
  for (ContactSurface& surface : loop.model.surfaces) {
    surface.static_friction = 2;
    surface.friction = 1.9;
  }
  const Point<World> tip(kBoneRadius_mm - 1, 0, 0);
  loop.lead({kBoneRadius_mm + 2, 0, 0}, tip, 100);
  const auto stuck = loop.record.device[0].proxy_patient_mm;
  // four degrees about the up axis: the surface point moves away under the tip by about a millimetre
  loop.parameters.rotation_target = Eigen::Quaterniond(Eigen::AngleAxisd(0.07, Eigen::Vector3d::UnitZ()));
  for (int n = 0; n < 10'000; ++n) loop.at(tip);
  const auto now = loop.record.device[0].proxy_patient_mm;
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(now[axis], stuck[axis], 1e-3) << "mm";
  EXPECT_GT(loop.wrench.force_N.y(), 0.5) << "dragged along with the object";
}

TEST(Tick, UnpreparedMethodIsFlaggedAndFallsBackToTrilinear) {
  TickedLoop with, without;
  without.parameters.method = ForceMethod::kSmoothSphere;
  const Point<World> tip(kBoneRadius_mm, 0, 0);
  with.at(tip);
  without.at(tip);
  EXPECT_EQ(with.record.device[0].flags & kFlagMethodMissing, 0u);
  EXPECT_NE(without.record.device[0].flags & kFlagMethodMissing, 0u);
  EXPECT_EQ(without.wrench.force_N, with.wrench.force_N);
  EXPECT_EQ(without.record.method, static_cast<std::uint8_t>(ForceMethod::kSmoothSphere)) << "the input";
  // the force source does not change, so nothing blends
  without.parameters.method = ForceMethod::kTrilinear;
  without.at(tip);
  EXPECT_EQ(without.record.device[0].flags & (kFlagMethodMissing | kFlagBlend), 0u);
}

TEST(Tick, OutsideTheVolumeIsFreeSpaceAndFlagged) {
  TickedLoop loop;
  for (const Point<World>& tip :
       {Point<World>(35, 0, 0), Point<World>(0, -1e9, 0), Point<World>(0, 0, 1e300)}) {
    loop.set_down_at(tip);
    EXPECT_EQ(loop.wrench.force_N, Vector<World>());
    EXPECT_TRUE(loop.record.device[0].flags & kFlagOutside);
  }
}

TEST(Tick, ViscosityActsDeepInsideWhereTheNormalVanishes) {
  TickedLoop loop;
  for (int n = 0; n < 30; ++n) loop.at(Point<World>(0.02 * n, 0, 0));
  EXPECT_EQ(loop.record.device[0].normal_patient, (std::array<double, 3>{}));
  // bone's viscosity at 20 mm/s
  EXPECT_NEAR(loop.wrench.force_N.x(), -20 * loop.model.tissues[0].viscosity_N_s_per_mm, 1e-6);
}

TEST(Tick, SeveralPointsGiveATorqueAboutTheTip) {
  TickedLoop loop;
  loop.parameters.friction = loop.parameters.viscosity = false;
  loop.model.tools[0].points_mm = {{0, 0, 0}, {10, 0, 0}};
  DeviceState device;
  // the second point, rotated towards +y, touches the top of the ball; the tip is in free space
  device.tip = Point<World>(0, kBoneRadius_mm + 10, 0);
  device.R_WorldTool = Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitZ());
  loop.at(device);
  EXPECT_GT(loop.wrench.force_N.y(), 0.5);
  const Vector<World> arm(0, -10, 0);
  EXPECT_LT((loop.wrench.torque_Nmm - arm.cross(loop.wrench.force_N)).norm(), 1e-9);
}

TEST(Tick, DevicesDoNotDisturbEachOther) {
  TickedLoop alone;
  TickedLoop both;
  std::array<DeviceState, 2> devices;
  std::array<Wrench, 2> wrenches;
  both.state.device[1].output.gain = 1;
  both.parameters.device[1] = alone.parameters.device[0];
  for (int n = 0; n < 50; ++n) {
    const Point<World> tip(kBoneRadius_mm, 0.05 * n, 0);
    alone.at(tip);
    devices[0].tip = Point<World>(-kBoneRadius_mm, 0, 0.1 * n);
    devices[1].tip = tip;
    tick(both.model, both.parameters, devices, kMillisecond_s, both.state, wrenches, both.record);
    EXPECT_EQ(wrenches[1].force_N, alone.wrench.force_N);
  }
}

TEST(Tick, StateHashIsRepeatableAndCoversEveryInput) {
  const auto run = [](double nudge, bool friction) {
    TickedLoop loop;
    loop.parameters.friction = friction;
    for (int n = 0; n < 40; ++n) loop.at(Point<World>(kBoneRadius_mm, 0.1 * n + (n == 20 ? nudge : 0), 0));
    return loop.record.state_hash;
  };
  EXPECT_EQ(run(0, true), run(0, true));
  EXPECT_NE(run(0, true), run(0, false));
  TickedLoop a, b;
  a.at(Point<World>(1, 2, 3));
  b.at(Point<World>(1, 2, std::nextafter(3.0, 4.0)));
  EXPECT_NE(a.record.state_hash, b.record.state_hash);
}

TEST(Tick, RecordContainsEveryInput) {
  TickedLoop loop;
  loop.parameters.viscosity = false;
  loop.parameters.passivity = true;
  loop.parameters.max_force_N = 1.25;
  loop.parameters.rotation_target = Rotation<World, World>::about(Eigen::Vector3d::UnitX(), 0.3).quaternion();
  loop.model.version = 9;
  DeviceParameters& own = loop.parameters.device[0];
  own = {1.5, 0.75, {8, 1.4, 300, 5, 900}, 2.5, 0.03, 0.02, 0.004};
  DeviceState device;
  device.tip = Point<World>(1, 2, 3);
  device.R_WorldTool = Rotation<World, World>::about(Eigen::Vector3d::UnitY(), 0.1).quaternion();
  device.velocity_mm_s = Vector<World>(4, 5, 6);
  device.angular_velocity_rad_s = Vector<World>(7, 8, 9);
  device.gripper_rad = 0.25;
  device.buttons = 5;
  device.status = kDeviceClutched;
  device.age_s = 1e-3;
  tick(loop.model, loop.parameters, {&device, 1}, 2e-3, loop.state, {&loop.wrench, 1}, loop.record);
  const DeviceTick& in = loop.record.device[0];
  EXPECT_EQ(in.velocity_world_mm_s, (std::array<double, 3>{4, 5, 6}));
  EXPECT_EQ(in.angular_velocity_world_rad_s, (std::array<double, 3>{7, 8, 9}));
  EXPECT_EQ(in.gripper_rad, 0.25);
  EXPECT_EQ(in.status, kDeviceClutched);
  EXPECT_EQ(in.age_s, 1e-3);
  EXPECT_EQ(in.force_gain, 1.5);
  EXPECT_EQ(in.scale, 0.75);
  EXPECT_EQ(in.peak_force_N, 8);
  EXPECT_EQ(in.continuous_force_N, 1.4);
  EXPECT_EQ(in.peak_torque_Nmm, 300);
  EXPECT_EQ(in.peak_gripper_N, 5);
  EXPECT_EQ(in.slew_N_per_s, 900);
  EXPECT_EQ(in.max_stiffness_N_per_mm, 2.5);
  EXPECT_EQ(in.position_step_mm, 0.03);
  EXPECT_EQ(in.max_damping_N_s_per_mm, 0.02);
  EXPECT_EQ(in.delay_s, 0.004);
  EXPECT_EQ(loop.record.device[0].tip_world_mm, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(loop.record.device[0].orientation_wxyz[0], device.R_WorldTool.w());
  EXPECT_EQ(loop.record.device[0].buttons, 5u);
  EXPECT_EQ(loop.record.switches, kSwitchFriction | kSwitchPassivity);
  EXPECT_EQ(loop.record.max_force_N, 1.25);
  EXPECT_EQ(loop.record.dt_s, 2e-3);
  EXPECT_EQ(loop.record.model_version, 9u);
  EXPECT_EQ(loop.record.rotation_target_wxyz[1], loop.parameters.rotation_target.x());
}

TEST(Tick, InvalidDurationSendsZeroAndKeepsTheState) {
  TickedLoop loop;
  // in contact, during a blend, with energy in the observer
  loop.parameters.passivity = true;
  loop.set_down_at(Point<World>(kBoneRadius_mm + 1, 0, 0));
  for (int n = 0; n < 20; ++n) loop.at(Point<World>(kBoneRadius_mm - 0.05 * n, 0, 0));
  loop.parameters.friction = false;
  loop.at(Point<World>(kBoneRadius_mm - 1, 0, 0));
  ASSERT_GT(loop.wrench.force_N.norm(), 0);
  const std::uint64_t before = loop.state.hash(1);

  DeviceState device;
  device.tip = Point<World>(kBoneRadius_mm - 1, 0, 0);
  for (const double dt_s : {-1.0, -1e-300, HUGE_VAL, -HUGE_VAL, std::nan("")}) {
    loop.wrench.force_N = {7, 7, 7};
    loop.record.device[0].label = 99;
    tick(loop.model, loop.parameters, {&device, 1}, dt_s, loop.state, {&loop.wrench, 1}, loop.record);
    EXPECT_EQ(loop.wrench.force_N, Vector<World>()) << dt_s;
    EXPECT_EQ(loop.state.hash(1), before) << dt_s;
    EXPECT_EQ(loop.record.state_hash, before) << dt_s;
    EXPECT_EQ(loop.record.device[0].flags, kFlagNotFinite) << dt_s;
    EXPECT_EQ(loop.record.device[0].label, 0) << dt_s;
    EXPECT_EQ(loop.record.tick, loop.state.tick) << dt_s;
  }
  loop.at(device);
  EXPECT_GT(loop.wrench.force_N.norm(), 0);
}

TEST(Tick, InvalidDeviceCountWrenchesOrModelSendZero) {
  TickedLoop loop;
  const std::uint64_t before = loop.state.hash(1);
  std::array<DeviceState, kMaxDevices + 1> devices;
  std::array<Wrench, kMaxDevices + 1> wrenches;
  const auto refused = [&](const Model& model, std::size_t states, std::size_t outputs) {
    wrenches.fill({{7, 7, 7}, {7, 7, 7}, 7});
    tick(model, loop.parameters, {devices.data(), states}, kMillisecond_s, loop.state,
         {wrenches.data(), outputs}, loop.record);
    for (std::size_t n = 0; n < outputs; ++n) EXPECT_EQ(wrenches[n].force_N, Vector<World>());
    EXPECT_EQ(loop.state.hash(1), before);
  };
  refused(loop.model, 0, 0);
  refused(loop.model, 0, 1);
  refused(loop.model, 2, 1);
  refused(loop.model, kMaxDevices + 1, kMaxDevices + 1);
  refused(Model(), 1, 1);
}

}  // namespace
}  // namespace palpate
