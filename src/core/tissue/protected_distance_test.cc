#include "palpate/tissue/protected_distance.h"

#include <gtest/gtest.h>

#include <cmath>

#include "contact/test_model.h"
#include "palpate/tissue/tissue_settings.h"
#include "tissue/test_surfaces.h"

namespace palpate {
namespace {

using testing::kBone;

// material below z = 0 is protected, with distances up to 4 mm
Model spared_below() {
  Model model = testing::ball_model({3, 3, 3});
  const auto above = [](const Eigen::Vector3d& p) { return p.z(); };
  model.protected_structures = {
      {kBone, testing::surface_to_carve(11, Eigen::Vector3d::Constant(0.5), above), false}};
  model.tools[0].radius_mm = 2;
  model.tools[0].burr = BurrSettings{.pedal = 3};
  return model;
}

TickRecord held_at(double z_mm) {
  TickRecord tick;
  tick.switches = kSwitchMotor;
  tick.device[0].proxy_patient_mm = {1, -2, z_mm};
  return tick;
}

TEST(ProtectedDistanceMeter, ReportsZeroForCutStructures) {
  ProtectedDistanceMeter meter(spared_below());
  meter.observe(Sweep{{0, 0, 8}, {1, 0, 8}, 2});
  EXPECT_TRUE(meter.nearest_mm().empty()) << "beyond what the distances tell";
  meter.observe(Sweep{{0, 0, 3}, {1, 0, 2.5}, 2});
  EXPECT_NEAR(meter.nearest_mm().at(kBone), 0.5, 0.01);
  meter.observe(Sweep{{0, 0, 3.5}, {0, 0, 3.5}, 2});
  EXPECT_NEAR(meter.nearest_mm().at(kBone), 0.5, 0.01) << "farther away again";
  meter.observe(Sweep{{0, 0, 4}, {0, 0, 1}, 2});
  EXPECT_EQ(meter.nearest_mm().at(kBone), 0);
}

TEST(ProtectedDistanceMeter, ReportsContactWithoutCutting) {
  ProtectedDistanceMeter meter(spared_below());
  TickRecord tick = held_at(3);
  meter.observe(tick);
  EXPECT_NEAR(meter.nearest_mm().at(kBone), 1, 0.01);
  // with several devices, each has the burr
  tick = held_at(3.5);
  tick.devices = 2;
  tick.device[1].proxy_patient_mm = {0, 0, 2.25};
  meter.observe(tick);
  EXPECT_NEAR(meter.nearest_mm().at(kBone), 0.25, 0.01);
  ProtectedDistanceMeter other(spared_below());
  other.observe(meter.nearest_mm());
  other.observe(held_at(3));
  EXPECT_EQ(other.nearest_mm(), meter.nearest_mm());
}

TEST(ProtectedDistanceMeter, CountsOnlyCuttingToolsWithRunningMotors) {
  Model model = spared_below();
  Tool& second = model.tools.emplace_back();
  second.radius_mm = 2;
  TickRecord tick = held_at(3.5);
  tick.devices = 2;
  tick.device[1].proxy_patient_mm = {0, 0, 2.25};
  ProtectedDistanceMeter beside_probe(model);
  beside_probe.observe(tick);
  EXPECT_NEAR(beside_probe.nearest_mm().at(kBone), 1.5, 0.01) << "a probe comes as near as it likes";
  // each device with its own head and pedal
  second.burr = BurrSettings{.pedal = 5};
  second.radius_mm = 1;
  ProtectedDistanceMeter beside_burr(model);
  tick.switches = 0;
  tick.device[0].buttons = 1u << 3;
  EXPECT_TRUE(motor_was_on(model, tick));
  beside_burr.observe(tick);
  EXPECT_NEAR(beside_burr.nearest_mm().at(kBone), 1.5, 0.01);
  tick.device[1].buttons = 1u << 3;
  beside_burr.observe(tick);
  EXPECT_NEAR(beside_burr.nearest_mm().at(kBone), 1.5, 0.01) << "the first one's pedal is not its own";
  tick.device[0].buttons = 0;
  EXPECT_FALSE(motor_was_on(model, tick));
  tick.device[1].buttons = 1u << 5;
  EXPECT_TRUE(motor_was_on(model, tick));
  beside_burr.observe(tick);
  EXPECT_NEAR(beside_burr.nearest_mm().at(kBone), 1.25, 0.01);
}

TEST(ProtectedDistanceMeter, CountsTheWholeCylinder) {
  Model model = spared_below();
  model.tools[0].burr->spindle = Eigen::Vector3d(0, 0, 1);
  model.tools[0].burr->length_mm = 5;
  model.tools[0].burr->end_radius_mm = 1;
  ProtectedDistanceMeter meter(model);
  TickRecord tick = held_at(7.5);
  // far end down in the patient, independent of the object's rotation
  const Eigen::Quaterniond object(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()));
  const Vector<World> down = model.X_WorldPatient * Vector<Patient>(0, 0, -1);
  const Eigen::Quaterniond rotation = shortest_rotation(Eigen::Vector3d::UnitZ(), object * down.eigen());
  tick.rotation_applied_wxyz = {object.w(), object.x(), object.y(), object.z()};
  tick.device[0].orientation_wxyz = {rotation.w(), rotation.x(), rotation.y(), rotation.z()};
  meter.observe(tick);
  EXPECT_NEAR(meter.nearest_mm().at(kBone), 7.5 - 5 - 1, 0.02);
  meter.observe(Sweep{{0, 0, 6}, {1, 0, 6}, 2, 0, {0, 0, -5}, 0.5});
  EXPECT_NEAR(meter.nearest_mm().at(kBone), 0.5, 0.02);
}

TEST(ProtectedDistanceMeter, CountsOnlyARunningBurr) {
  const Model model = spared_below();
  ProtectedDistanceMeter meter(model);
  TickRecord tick = held_at(2);
  tick.switches = 0;
  meter.observe(tick);
  for (const std::uint32_t flag :
       {kFlagPaused, kFlagClutched, kFlagRamp, kFlagInside, kFlagJump, kFlagEmergencyStop}) {
    tick = held_at(2);
    tick.device[0].flags = flag;
    meter.observe(tick);
  }
  tick = held_at(2);
  tick.device[0].age_s = kCuttingSettings.motor_timeout_s;
  meter.observe(tick);
  EXPECT_TRUE(meter.nearest_mm().empty());
  // its pose is stale, and it keeps running
  ProtectedDistanceMeter late(model);
  tick.device[0].age_s = 0.9 * kCuttingSettings.motor_timeout_s;
  tick.device[0].flags = kFlagStale;
  late.observe(tick);
  EXPECT_NEAR(late.nearest_mm().at(kBone), 0, 0.01);
  tick = held_at(2);
  tick.switches = 0;
  tick.device[0].buttons = 1u << 3;
  EXPECT_TRUE(motor_was_on(model, tick)) << "by its pedal";
  meter.observe(tick);
  EXPECT_NEAR(meter.nearest_mm().at(kBone), 0, 0.01);
  EXPECT_FALSE(motor_was_on(Model(), held_at(2))) << "a tool without a motor";
}

}  // namespace
}  // namespace palpate
