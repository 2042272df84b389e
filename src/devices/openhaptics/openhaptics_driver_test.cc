#include "palpate/openhaptics/openhaptics_driver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <mutex>

#include "base/test_folder.h"
#include "contact/test_model.h"
#include "openhaptics/test_hd_rig.h"
#include "palpate/device/bounds.h"
#include "palpate/servo/servo_loop.h"

/// The driver with working devices.
namespace palpate {
namespace {

using testing::fake_hd;
using testing::fake_hd_settings;
using testing::FakeHd;
using ::testing::HasSubstr;
using testing::HdRig;
using testing::soon;

// sends a constant force and records the last samples
class HdConstant final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    const std::lock_guard lock(mutex_);
    for (DeviceCommand& command : commands) command = {Vector<Device>(0.25, -0.5, 0.75), {}, 0};
    last_.assign(samples.begin(), samples.end());
    thread_ = std::this_thread::get_id();
  }
  std::vector<DeviceSample> last() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }
  std::thread::id thread() const {
    const std::lock_guard lock(mutex_);
    return thread_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<DeviceSample> last_;
  std::thread::id thread_;
};

struct HdModelCase {
  const char* model;
  double answers_N, answers_continuous_N;  ///< 0: not reported
  double peak_N, continuous_N, step_mm;    ///< 0: unknown
};
class HdModels : public ::testing::TestWithParam<HdModelCase> {};
// values reported by the device, otherwise from the reference's table of limits
INSTANTIATE_TEST_SUITE_P(Each, HdModels,
                         ::testing::Values(HdModelCase{"Touch", 3.1, 0.9, 3.1, 0.9, 0.055},
                                           HdModelCase{"PHANToM Omni", 0, 0, 3.3, 0.88, 0.055},
                                           HdModelCase{"Touch X", 0, 0, 7.9, 1.75, 0.023},
                                           HdModelCase{"PHANTOM Desktop", 0, 1.5, 7.9, 1.5, 0.023},
                                           HdModelCase{"Premium 1.5", 8, 0, 8, 1.4, 0.03},
                                           HdModelCase{"Something new", 0, 0, 0, 0, 0}),
                         [](const auto& tested) {
                           std::string name = tested.param.model;
                           std::erase_if(name, [](char c) { return c == ' ' || c == '.'; });
                           return name;
                         });

TEST_P(HdModels, ReportTheirProperties) {
  const HdModelCase& expected = GetParam();
  HdRig rig(false);
  rig.device.model = expected.model;
  rig.device.max_force_N = expected.answers_N;
  rig.device.continuous_N = expected.answers_continuous_N;
  ASSERT_TRUE(rig.driver->open(false).ok());
  ASSERT_EQ(rig.driver->devices().size(), 1u);
  const DeviceInfo& info = rig.driver->devices()[0];
  EXPECT_EQ(info.name, std::string(expected.model) + " no. 4711");
  EXPECT_EQ(info.drive, DeviceInfo::Drive::kCallback);
  EXPECT_FALSE(info.simulated);
  EXPECT_EQ(info.peak_force_N.value_or(0), expected.peak_N);
  EXPECT_EQ(info.continuous_force_N.value_or(0), expected.continuous_N);
  EXPECT_EQ(info.position_step_mm.value_or(0), expected.step_mm);
  EXPECT_FALSE(info.stiffness_N_per_mm) << "it was not answered";
  EXPECT_FALSE(info.peak_torque_Nmm);
  EXPECT_EQ(info.rate_hz, 1000);
  EXPECT_EQ(info.degrees_of_freedom_in, 6);
  EXPECT_EQ(info.degrees_of_freedom_out, 3);
  EXPECT_EQ(info.buttons, 2);
  ASSERT_TRUE(info.workspace);
  EXPECT_EQ(info.workspace->low, Point<Device>(-80, -60, -35));
  EXPECT_EQ(info.workspace->high, Point<Device>(80, 60, 35));
  // device axes: right, up, towards the user
  EXPECT_NEAR((info.R_WorldDevice * Vector<Device>(1, 2, 3) - Vector<World>(1, -3, 2)).norm(), 0, 1e-12);
  EXPECT_TRUE(rig.device.ramping && rig.device.clamping && rig.device.force_on);
}

TEST(OpenHaptics, StiffnessIsTheVendorsRating) {
  HdRig rig(false);
  rig.device.stiffness_N_per_mm = 0.8;
  ASSERT_TRUE(rig.driver->open(false).ok());
  EXPECT_EQ(rig.driver->devices()[0].stiffness_N_per_mm, 0.8);
}

TEST(OpenHaptics, EachAxisUnitAndButtonIsInItsPlace) {
  HdRig rig(false);
  rig.device.intended_x_mm = 10;
  rig.device.intended_y_mm = -20;
  rig.device.intended_z_mm = 30;
  rig.device.turned_rad = 0.5;
  rig.device.buttons = 2;
  rig.device.velocity_x_mm_s = 10'000;
  rig.device.velocity_y_mm_s = -20'000;
  rig.device.velocity_z_mm_s = 30'000;
  ASSERT_TRUE(rig.driver->open(false).ok());
  HdConstant servo;
  std::thread running([&] { rig.driver->run(servo, rig.clock); });
  EXPECT_TRUE(soon([&] { return rig.device.force_N > 0.9; }));
  // the hand yields by at most half a millimetre
  const DeviceSample sample = servo.last()[0];
  EXPECT_NEAR(sample.tip.x(), 10, 0.6);
  EXPECT_NEAR(sample.tip.y(), -20, 0.6);
  EXPECT_NEAR(sample.tip.z(), 30, 0.6);
  // in addition to the hand's velocity, which vanishes
  EXPECT_NEAR((sample.velocity_mm_s - Vector<Device>(10'000, -20'000, 30'000)).norm(), 0, 500);
  EXPECT_EQ(sample.angular_velocity_rad_s, Vector<Device>(0.1, 0.2, 0.3));
  EXPECT_EQ(sample.buttons, 2u);
  EXPECT_TRUE(std::isnan(sample.gripper_rad));
  // column-major, and orthonormalised
  EXPECT_NEAR(sample.R_DeviceTool.norm(), 1, 1e-12);
  const Eigen::AngleAxisd turn(sample.R_DeviceTool);
  EXPECT_NEAR(turn.angle() * turn.axis().y(), 0.5, 1e-3);
  EXPECT_EQ(rig.device.requested_x_N, 0.25);
  EXPECT_EQ(rig.device.requested_y_N, -0.5);
  EXPECT_EQ(rig.device.requested_z_N, 0.75);
  EXPECT_NE(servo.thread(), running.get_id()) << "the maker's own";
  rig.clock.stop = true;
  running.join();
  EXPECT_EQ(rig.device.force_N, 0);
  EXPECT_EQ(rig.device.requested_x_N, 0) << "a frame with a zero";
  EXPECT_FALSE(rig.fake.running);
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(OpenHaptics, CompensatesHeldMassWithinPeakForce) {
  OpenHapticsSettings settings = fake_hd_settings();
  settings.held_mass_kg = 0.1;
  {
    HdRig rig(false, settings);
    rig.device.continuous_N = 1.5;
    rig.device.intended_x_mm = -5;
    ASSERT_TRUE(rig.driver->open(false).ok());
    // remaining force for contact
    EXPECT_NEAR(*rig.driver->devices()[0].peak_force_N, 3.3 - 0.981, 1e-12);
    EXPECT_NEAR(*rig.driver->devices()[0].continuous_force_N, 1.5 - 0.981, 1e-12);
    rig.begin();
    // away from the wall there is only the compensation
    EXPECT_TRUE(soon([&] { return std::abs(rig.device.requested_y_N - 0.981) < 1e-9; }));
    EXPECT_EQ(rig.device.requested_x_N, 0);
    rig.driver->halt();
    EXPECT_TRUE(soon([&] { return rig.device.requested_y_N == 0 && rig.device.force_N == 0; }));
    rig.driver->resume(0);
    // it is ramped
    EXPECT_TRUE(soon([&] { return rig.device.requested_y_N > 0.01 && rig.device.requested_y_N < 0.9; }));
    rig.end();
    EXPECT_LE(rig.device.largest_N, 0.981 + 1e-9);
  }
  // a servo that commands more than the remaining force
  class Upward final : public ServoFunction {
   public:
    void update(std::span<const DeviceSample>, std::span<DeviceCommand> commands) noexcept override {
      for (DeviceCommand& command : commands) command = {Vector<Device>(0, 3, 0), {}, 0};
    }
  } upward;
  HdRig rig(false, settings);
  rig.device.continuous_N = 1.5;
  ASSERT_TRUE(rig.driver->open(false).ok());
  std::thread running([&] { rig.driver->run(upward, rig.clock); });
  EXPECT_TRUE(soon([&] { return rig.device.largest_N > 3.29; }));
  rig.clock.stop = true;
  running.join();
  EXPECT_LE(rig.device.largest_N, 3.3 + 1e-9);
}

TEST(OpenHaptics, ExcessiveMassIsNotCompensated) {
  OpenHapticsSettings settings = fake_hd_settings();
  for (const double mass_kg : {0.1, 0.4}) {
    settings.held_mass_kg = mass_kg;
    HdRig rig(false, settings);
    // above the continuous rating, then above the peak force
    if (mass_kg > 0.3) rig.device.continuous_N = 5;
    const auto refused = rig.driver->open(false);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().kind, ErrorKind::kUsage);
    EXPECT_THAT(refused.error().message(), HasSubstr("the tool weighs"));
    EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  }
}

TEST(OpenHaptics, WithoutItsOwnGuardsItIsNotBegun) {
  HdRig rig(false);
  rig.device.unguarded = true;
  const auto refused = rig.driver->open(false);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kUnavailable);
  EXPECT_THAT(refused.error().message(), HasSubstr("the force limits of the library"));
}

class HdCalibrations : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Styles, HdCalibrations, ::testing::Values(1, 2, 4, 5, 6, 7));

// the fake counts steps out of order
TEST_P(HdCalibrations, AreDoneInTheirOrder) {
  HdRig rig(false);
  rig.device.style = GetParam();
  rig.device.calibrated = false;
  rig.device.in_inkwell = false;
  ASSERT_TRUE(rig.driver->open(false).ok());
  rig.begin();
  if ((GetParam() & 4) && !(GetParam() & 2)) {
    EXPECT_TRUE(rig.says("not calibrated"));
    EXPECT_THAT(rig.driver->failure()->remedy, HasSubstr("inkwell"));
    EXPECT_EQ(rig.device.force_N, 0);
    rig.device.in_inkwell = true;
  }
  EXPECT_TRUE(rig.presses());
  EXPECT_EQ(rig.device.updates, 1);
  rig.end();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(OpenHaptics, HaltGivesZerosUntilResume) {
  HdRig rig;
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(rig.presses());
    rig.driver->halt();
    EXPECT_EQ(rig.device.force_N, 0) << "at once, whatever the servo does";
    const int then = rig.wall.samples_taken;
    EXPECT_TRUE(soon([&] { return rig.wall.samples_taken > then + 20; })) << "the servo goes on";
    EXPECT_EQ(rig.device.force_N, 0);
    EXPECT_FALSE(rig.driver->failure()) << "it is no fault of the device's";
    rig.driver->resume(0);
  }
  EXPECT_TRUE(rig.presses());
  rig.end();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(OpenHaptics, StopSendsZeroAndReadingContinues) {
  HdRig rig;
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(rig.presses()) << round;
    rig.end();
    EXPECT_EQ(rig.device.force_N, 0);
    EXPECT_EQ(rig.device.requested_x_N, 0) << "asked for, and not the switch alone";
    EXPECT_FALSE(rig.fake.running);
    rig.begin();
  }
  EXPECT_TRUE(rig.presses());
  rig.end();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

// forces disabled by a halt are enabled by the next run
TEST(OpenHaptics, RunAfterAHaltedOneHasForce) {
  HdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.driver->halt();
  rig.end();
  rig.driver->resume(0);
  EXPECT_FALSE(rig.device.force_on);
  rig.begin();
  EXPECT_TRUE(rig.presses());
  rig.end();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(OpenHaptics, SeveralDevicesAreOneSchedulers) {
  OpenHapticsSettings settings = fake_hd_settings();
  settings.names = {"Left Device", "Default PHANToM"};
  FakeHd& fake = fake_hd();
  fake.device[1].intended_x_mm = -3;
  OpenHapticsDriver driver(settings);
  const auto opened = driver.open(false);
  ASSERT_TRUE(opened.ok()) << opened.error().message();
  ASSERT_EQ(driver.devices().size(), 2u);
  EXPECT_EQ(driver.devices()[0].name, "Touch no. 4712");
  HdConstant servo;
  testing::UntilStopped clock;
  std::thread running([&] { driver.run(servo, clock); });
  EXPECT_TRUE(soon([&] { return fake.device[0].force_N > 0.9 && fake.device[1].force_N > 0.9; }));
  EXPECT_NEAR(servo.last()[0].tip.x(), -3, 0.2);
  EXPECT_NEAR(servo.last()[1].tip.x(), 1.2, 0.2);
  driver.halt();
  EXPECT_TRUE(soon([&] { return fake.device[0].force_N == 0 && fake.device[1].force_N == 0; }));
  driver.resume(0);
  EXPECT_TRUE(soon([&] { return fake.device[0].force_N > 0.9 && fake.device[1].force_N > 0.9; }));
  clock.stop = true;
  running.join();
  EXPECT_EQ(fake.violations, 0) << fake.first_violation.load();
}

TEST(OpenHaptics, InALoopNothingIsStrongerOrStifferThanItBears) {
  HdRig rig(false);
  // the ball's surface is to the right of the centre of the device's workspace
  rig.device.intended_x_mm = testing::kBoneRadius_mm - 3;
  Parameters parameters;
  parameters.max_force_N = 30;
  auto loop = ServoLoop::start(std::make_shared<const Model>(testing::ball_model({1, 1, 1})), *rig.driver,
                               parameters, {WorkspaceSettings{}}, {.realtime = false, .ring_s = 10});
  ASSERT_TRUE(loop.ok()) << loop.error().message();
  EXPECT_TRUE(soon([&] { return rig.device.force_N > 0.1; }))
      << (*loop)->snapshot().device[0].tip_world_mm[0];
  const TickRecord tick = (*loop)->snapshot();
  EXPECT_FLOAT_EQ(static_cast<float>(tick.device[0].peak_force_N), 3.3F);
  EXPECT_EQ(tick.device[0].max_stiffness_N_per_mm,
            conservative_bounds(rig.driver->devices()[0]).stiffness_N_per_mm);
  (*loop)->stop();
  EXPECT_LE(rig.device.largest_N, 3.3);
  EXPECT_EQ(rig.device.force_N, 0);
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(OpenHaptics, OpenFailuresHaveReasonAndRemedy) {
  const auto refusal = [](OpenHapticsDriver& driver) {
    const auto opened = driver.open(false);
    EXPECT_FALSE(opened.ok());
    if (opened.ok()) return std::string();
    EXPECT_EQ(opened.error().kind, ErrorKind::kUnavailable);
    EXPECT_FALSE(opened.error().remedy.empty()) << opened.error().what;
    return opened.error().message();
  };
  FakeHd& fake = fake_hd();
  OpenHapticsDriver driver(fake_hd_settings());
  fake.device[0].plugged = false;
  EXPECT_THAT(refusal(driver), HasSubstr("Communication error"));
  fake.device[0].plugged = true;
  fake.licence = false;
  EXPECT_THAT(refusal(driver), HasSubstr("licence"));
  fake.licence = true;
  // versions without NULL as a name
  fake.null_name = false;
  EXPECT_TRUE(driver.open(false).ok());
  EXPECT_TRUE(driver.open(false).ok()) << "again";
  EXPECT_EQ(fake.device[0].inits, 1);

  OpenHapticsSettings settings;
  settings.library.file = "/no/such/libHD.so";
  OpenHapticsDriver nothing(settings);
  EXPECT_THAT(refusal(nothing), HasSubstr("/no/such/libHD.so: there is no such file"));
  const test::TemporaryFolder empty;
  settings.library.file.clear();
  settings.library.folders = {empty.path()};
  OpenHapticsDriver nowhere(settings);
  EXPECT_THAT(refusal(nowhere), HasSubstr("no libHD.so or"));
  OpenHapticsDriver too_old(fake_hd_settings(PALPATE_FAKE_OLD_HD));
  EXPECT_THAT(refusal(too_old), HasSubstr("does not have hdCheckCalibration\n"));
  settings = fake_hd_settings();
  settings.names = {"Right Device"};
  OpenHapticsDriver another(settings);
  EXPECT_THAT(refusal(another), HasSubstr("Right Device: "));
}

TEST(OpenHaptics, IsLookedForWithoutMovingAnything) {
  FakeHd& fake = fake_hd();
  const DeviceVendor vendor = openhaptics_vendor(fake_hd_settings());
  EXPECT_EQ(vendor.name, "touch");
  DeviceReport report = vendor.detect();
  ASSERT_EQ(report.connected.size(), 1u);
  EXPECT_EQ(report.connected[0].id, "Touch no. 4711");
  EXPECT_EQ(report.connected[0].state, "ready");
  for (const DeviceCheck& check : report.checks) EXPECT_TRUE(check.passed) << check.what;
  EXPECT_FALSE(fake.running);
  EXPECT_FALSE(fake.device[0].force_on);
  EXPECT_EQ(fake.violations, 0) << fake.first_violation.load();

  fake.device[0].plugged = false;
  report = vendor.detect();
  EXPECT_TRUE(report.connected.empty());
  EXPECT_FALSE(report.checks[1].passed);
  for (const DeviceCheck& check : report.checks) EXPECT_EQ(check.remedy.empty(), check.passed) << check.what;
}

}  // namespace
}  // namespace palpate
