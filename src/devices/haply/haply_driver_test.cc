#include "palpate/haply/haply_driver.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "contact/test_model.h"
#include "haply/test_haply_rig.h"
#include "palpate/device/bounds.h"
#include "palpate/servo/servo_loop.h"

/// The driver with a working service.
namespace palpate {
namespace {

using testing::FakeInverseService;
using testing::HaplyRig;
using testing::soon;

// sends a constant force
class Constant final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    commands[0].force_N = Vector<Device>(0.25, -0.5, 0.75);
    const std::lock_guard lock(mutex_);
    last_ = samples[0];
    ++updates_;
  }
  DeviceSample last() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }
  int updates() const {
    const std::lock_guard lock(mutex_);
    return updates_;
  }

 private:
  mutable std::mutex mutex_;
  DeviceSample last_;
  int updates_ = 0;
};

TEST(HaplyDriver, ReportsDeviceProperties) {
  const HaplyRig rig;
  ASSERT_EQ(rig.driver->devices().size(), 1u);
  const DeviceInfo& info = rig.driver->devices()[0];
  EXPECT_EQ(info.name, "Inverse3 049D");
  EXPECT_EQ(info.drive, DeviceInfo::Drive::kExchange);
  EXPECT_FALSE(info.simulated);
  EXPECT_EQ(info.peak_force_N, 3);
  EXPECT_FALSE(info.stiffness_N_per_mm) << "the maker states none";
  ASSERT_TRUE(info.rate_hz);
  EXPECT_LE(*info.rate_hz, HaplySettings{}.max_rate_hz);
  EXPECT_GT(*info.rate_hz, 0);
  EXPECT_EQ(info.degrees_of_freedom_in, 6);
  ASSERT_TRUE(info.workspace);
  // the largest cube in a ball of 100 mm radius
  EXPECT_NEAR((info.workspace->high - info.workspace->low).norm(), 200, 0.2);
  EXPECT_EQ(info.R_WorldDevice * Vector<Device>(1, 2, 3), Vector<World>(1, 2, 3));
}

class HaplyVersions : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Services, HaplyVersions, ::testing::Values("3.0.2", "3.1.1", "3.5.0", "3.6.2"),
                         [](const auto& tested) {
                           std::string name = tested.param;
                           std::ranges::replace(name, '.', '_');
                           return "v" + name;
                         });

// a force with the key of another version has no effect
TEST_P(HaplyVersions, AreDistinguishedAndRendered) {
  HaplyRig rig(GetParam());
  EXPECT_TRUE(rig.presses()) << rig.wall.tip_x_mm << " " << rig.service.last_message();
  EXPECT_FALSE(rig.driver->failure());
  rig.end();
  EXPECT_EQ(rig.service.violations(), 0) << rig.service.last_message();
  EXPECT_TRUE(soon([&] { return rig.service.force_N() == 0; }));
}

TEST(HaplyDriver, EachAxisUnitAndButtonIsInItsPlace) {
  FakeInverseService service(testing::haply_hand(Point<Device>(10, -20, 30)));
  service.buttons = 1;
  service.turned_rad = 0.5;
  HaplyDriver driver(service.settings());
  ASSERT_TRUE(driver.open(false).ok());
  Constant servo;
  testing::UntilStopped clock;
  std::thread running([&] { driver.run(servo, clock); });
  EXPECT_TRUE(soon([&] { return servo.updates() > 3; }));
  // the hand yields by a little more than a quarter of a millimetre
  const DeviceSample sample = servo.last();
  EXPECT_NEAR(sample.tip.x(), 10, 0.5);
  EXPECT_NEAR(sample.tip.y(), -20, 0.5);
  EXPECT_NEAR(sample.tip.z(), 30, 0.5);
  EXPECT_EQ(sample.velocity_mm_s, Vector<Device>());
  EXPECT_EQ(sample.buttons, 1u);
  const Eigen::AngleAxisd turn(sample.R_DeviceTool);
  EXPECT_NEAR(turn.angle() * turn.axis().z(), 0.5, 1e-6);
  service.buttons = 0;
  EXPECT_TRUE(soon([&] { return servo.last().buttons == 0; }));

  EXPECT_TRUE(soon([&] { return service.force_N() > 0; }));
  const auto force = nlohmann::json::parse(service.last_message())
                         .at("inverse3")
                         .at(0)
                         .at("commands")
                         .at("set_cursor_force")
                         .at("values");
  EXPECT_EQ(force.at("x"), 0.25);
  EXPECT_EQ(force.at("y"), -0.5);
  EXPECT_EQ(force.at("z"), 0.75);
  clock.stop = true;
  running.join();
  EXPECT_TRUE(soon([&] { return service.force_N() == 0; }));
  EXPECT_EQ(service.violations(), 0);
}

TEST(HaplyDriver, HaltGivesZerosUntilResume) {
  HaplyRig rig;
  ASSERT_TRUE(rig.presses());
  rig.driver->halt();
  EXPECT_TRUE(soon([&] { return rig.service.force_N() == 0; }));
  const int then = rig.wall.samples_taken;
  EXPECT_TRUE(soon([&] { return rig.wall.samples_taken > then + 20; })) << "the servo goes on asking";
  EXPECT_EQ(rig.service.force_N(), 0);
  rig.driver->resume(0);
  EXPECT_TRUE(rig.presses());
}

TEST(HaplyDriver, StopSendsZeroAndReadingContinues) {
  HaplyRig rig;
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(rig.presses()) << round;
    rig.end();
    // requested zero, as opposed to the device's idle state; a loaded service processes it some time after it
    // was sent
    EXPECT_TRUE(soon([&] {
      auto supplied = rig.service.delivered();
      std::erase_if(supplied, [](const testing::Delivery& delivery) { return delivery.idle; });
      return supplied.back().command.force_N == Vector<Device>();
    }));
    EXPECT_TRUE(soon([&] { return rig.service.force_N() == 0; }));
    rig.begin();
  }
}

TEST(HaplyDriver, InALoopNothingIsStrongerOrStifferThanItBears) {
  // the ball's surface is 12 mm to the right of the centre of the workspace
  FakeInverseService service(testing::haply_hand(Point<Device>(testing::kBoneRadius_mm - 3, -120, 150)));
  HaplyDriver driver(service.settings());
  Parameters parameters;
  parameters.max_force_N = 30;
  auto loop = ServoLoop::start(std::make_shared<const Model>(testing::ball_model({1, 1, 1})), driver,
                               parameters, {WorkspaceSettings{}}, {.realtime = false, .ring_s = 10});
  ASSERT_TRUE(loop.ok()) << loop.error().message();
  EXPECT_TRUE(soon([&] { return service.force_N() > 0.1; })) << (*loop)->snapshot().device[0].tip_world_mm[0];
  const TickRecord tick = (*loop)->snapshot();
  EXPECT_EQ(tick.device[0].peak_force_N, 3);
  EXPECT_EQ(tick.device[0].max_stiffness_N_per_mm,
            conservative_bounds(driver.devices()[0]).stiffness_N_per_mm);
  EXPECT_LT(tick.device[0].max_stiffness_N_per_mm, 0.3);
  (*loop)->stop();
  for (const testing::Delivery& delivery : service.delivered()) EXPECT_LE(delivery.command.force_N.norm(), 3);
  EXPECT_TRUE(soon([&] { return service.force_N() == 0; }));
  EXPECT_EQ(service.violations(), 0);
}

TEST(HaplyDriver, OpenFailuresHaveReasonAndRemedy) {
  HaplyRig rig("3.1.1", false);
  FakeInverseService& service = rig.service;
  const auto refusal = [&] {
    const auto opened = rig.driver->open(false);
    EXPECT_FALSE(opened.ok());
    if (opened.ok()) return std::string();
    EXPECT_EQ(opened.error().kind, ErrorKind::kUnavailable);
    EXPECT_FALSE(opened.error().remedy.empty()) << opened.error().what;
    return opened.error().message();
  };
  service.stop();
  EXPECT_NE(refusal().find("no Inverse Service answers"), std::string::npos);
  service.start("4.0.0");
  EXPECT_NE(refusal().find("is not supported: 4.0"), std::string::npos);
  service.stop();
  service.start("3.1.1");
  service.present = false;
  EXPECT_NE(refusal().find("detects no Inverse3"), std::string::npos);
  service.present = true;
  service.in_use = true;
  EXPECT_NE(refusal().find("another program"), std::string::npos);
  service.in_use = false;
  service.calibrated = false;
  EXPECT_NE(refusal().find("not calibrated"), std::string::npos);
  service.calibrated = true;
  service.power = false;
  EXPECT_NE(refusal().find("no power"), std::string::npos);
  service.power = true;
  service.says_other = true;
  EXPECT_NE(refusal().find("not device states"), std::string::npos);
  service.says_other = false;
  EXPECT_TRUE(rig.driver->open(false).ok());
  EXPECT_TRUE(rig.driver->open(false).ok()) << "again";
  EXPECT_EQ(rig.driver->devices().size(), 1u);
}

TEST(HaplyDriver, IsLookedForWithoutMovingAnything) {
  FakeInverseService service(testing::haply_hand());
  const DeviceVendor vendor = haply_vendor(service.settings());
  EXPECT_EQ(vendor.name, "haply");
  DeviceReport report = vendor.detect();
  ASSERT_EQ(report.connected.size(), 1u);
  EXPECT_EQ(report.connected[0].id, "049D");
  EXPECT_EQ(report.connected[0].state, "ready");
  for (const DeviceCheck& check : report.checks) EXPECT_TRUE(check.passed) << check.what;
  EXPECT_EQ(service.messages(), 0u);

  service.calibrated = false;
  report = vendor.detect();
  EXPECT_EQ(report.connected[0].state, "the device is not calibrated");
  EXPECT_FALSE(report.checks.back().passed);
  EXPECT_FALSE(report.checks.back().remedy.empty());
  service.stop();
  report = vendor.detect();
  ASSERT_EQ(report.checks.size(), 1u);
  EXPECT_FALSE(report.checks[0].passed);
  EXPECT_TRUE(report.connected.empty());
}

}  // namespace
}  // namespace palpate
