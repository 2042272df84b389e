#include "palpate/force_dimension/force_dimension_driver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <mutex>
#include <vector>

#include "base/test_folder.h"
#include "contact/test_model.h"
#include "force_dimension/test_dhd_rig.h"
#include "palpate/device/bounds.h"
#include "palpate/servo/servo_loop.h"

/// The driver with working devices.
namespace palpate {
namespace {

using testing::DhdRig;
using testing::fake_dhd;
using testing::fake_dhd_settings;
using testing::FakeDhd;
using ::testing::HasSubstr;
using testing::soon;

// sends a constant wrench and records the last samples
class DhdConstant final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    const std::lock_guard lock(mutex_);
    for (DeviceCommand& command : commands) command = command_;
    last_.assign(samples.begin(), samples.end());
    ++updates_;
  }
  std::vector<DeviceSample> last() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }
  int updates() const {
    const std::lock_guard lock(mutex_);
    return updates_;
  }

 private:
  const DeviceCommand command_{Vector<Device>(0.25, -0.5, 0.75), Vector<Device>(10, 20, -30), 1.5};
  mutable std::mutex mutex_;
  std::vector<DeviceSample> last_;
  int updates_ = 0;
};

struct DhdModelCase {
  int type;
  const char* name;
  double peak_N;
  int in, out, buttons;
  bool left, turns, gripper;
  double torque_Nmm, gripper_N;  ///< 0: unknown or not available
  double reach_mm, step_mm;
};
class DhdModels : public ::testing::TestWithParam<DhdModelCase> {};
// the reference's table of limits, and the capabilities of each device
INSTANTIATE_TEST_SUITE_P(
    Each, DhdModels,
    ::testing::Values(DhdModelCase{33, "omega.3", 12, 3, 3, 1, false, false, false, 0, 0, 75, 0.01},
                      DhdModelCase{34, "omega.6", 12, 6, 3, 1, false, true, false, 0, 0, 75, 0.01},
                      DhdModelCase{36, "omega.6", 12, 6, 3, 1, true, true, false, 0, 0, 75, 0.01},
                      DhdModelCase{35, "omega.7", 12, 7, 4, 1, false, true, true, 0, 8, 75, 0.01},
                      DhdModelCase{37, "omega.7", 12, 7, 4, 1, true, true, true, 0, 8, 75, 0.01},
                      DhdModelCase{104, "sigma.7", 20, 7, 7, 1, false, true, true, 400, 0, 75, 0.0015},
                      DhdModelCase{105, "sigma.7", 20, 7, 7, 1, true, true, true, 400, 0, 75, 0.0015},
                      DhdModelCase{60, "Falcon", 8, 3, 3, 4, false, false, false, 0, 0, 40, 0.063}),
    [](const auto& tested) { return "type" + std::to_string(tested.param.type); });

TEST_P(DhdModels, ReportTheirProperties) {
  const DhdModelCase& expected = GetParam();
  DhdRig rig(expected.type, false);
  rig.device.left = expected.left;
  ASSERT_TRUE(rig.driver->open(false).ok());
  ASSERT_EQ(rig.driver->devices().size(), 1u);
  const DeviceInfo& info = rig.driver->devices()[0];
  EXPECT_EQ(info.name, std::string(expected.name) + (expected.left ? " (left)" : "") + " no. 117");
  EXPECT_EQ(info.drive, DeviceInfo::Drive::kPulled);
  EXPECT_FALSE(info.simulated);
  EXPECT_EQ(info.peak_force_N, expected.peak_N);
  EXPECT_FALSE(info.continuous_force_N);
  EXPECT_FALSE(info.stiffness_N_per_mm);
  EXPECT_FALSE(info.delay_s);
  EXPECT_EQ(info.peak_torque_Nmm.value_or(0), expected.torque_Nmm);
  EXPECT_EQ(info.peak_gripper_N.value_or(0), expected.gripper_N);
  EXPECT_EQ(info.position_step_mm, expected.step_mm);
  EXPECT_EQ(info.degrees_of_freedom_in, expected.in);
  EXPECT_EQ(info.degrees_of_freedom_out, expected.out);
  EXPECT_EQ(info.buttons, expected.buttons);
  EXPECT_EQ(info.gripper, expected.gripper);
  ASSERT_TRUE(info.workspace);
  EXPECT_NEAR((info.workspace->high - info.workspace->low).norm(), 2 * expected.reach_mm, 1e-9);
  // device axes: towards the user, right, up
  EXPECT_NEAR((info.R_WorldDevice * Vector<Device>(1, 2, 3) - Vector<World>(2, -1, 3)).norm(), 0, 1e-12);
  // also set at the device
  EXPECT_EQ(rig.device.max_force_N, expected.peak_N);
  EXPECT_EQ(rig.device.gravity, 1);
  EXPECT_EQ(rig.device.held_kg, -1);
}

TEST_P(DhdModels, EachAxisUnitButtonAndTheGripperIsInItsPlace) {
  const DhdModelCase& expected = GetParam();
  DhdRig rig(expected.type, false);
  rig.device.intended_x_mm = 10;
  rig.device.intended_y_mm = -20;
  rig.device.intended_z_mm = 30;
  rig.device.turned_rad = 0.5;
  rig.device.gripper_rad = 0.3;
  rig.device.buttons = 5;
  rig.device.velocity_x_m_s = 0.001;
  rig.device.velocity_y_m_s = -0.002;
  rig.device.velocity_z_m_s = 0.003;
  rig.device.says_velocity = true;
  ASSERT_TRUE(rig.driver->open(false).ok());
  DhdConstant servo;
  std::thread running([&] { rig.driver->run(servo, rig.clock); });
  EXPECT_TRUE(soon([&] { return rig.device.force_N > 0.9; }));
  // the hand yields by at most half a millimetre
  const DeviceSample sample = servo.last()[0];
  EXPECT_NEAR(sample.tip.x(), 10, 0.6);
  EXPECT_NEAR(sample.tip.y(), -20, 0.6);
  EXPECT_NEAR(sample.tip.z(), 30, 0.6);
  EXPECT_NEAR((sample.velocity_mm_s - Vector<Device>(1, -2, 3)).norm(), 0, 1e-12);
  EXPECT_EQ(sample.buttons, 5u);
  const Eigen::AngleAxisd turn(sample.R_DeviceTool);
  EXPECT_NEAR(turn.angle() * turn.axis().z(), expected.turns ? 0.5 : 0, 1e-9);
  if (expected.gripper)
    EXPECT_EQ(sample.gripper_rad, 0.3);
  else
    EXPECT_TRUE(std::isnan(sample.gripper_rad));
  // N unchanged, N mm converted to N m
  EXPECT_EQ(rig.device.requested_x_N, 0.25);
  EXPECT_EQ(rig.device.requested_y_N, -0.5);
  EXPECT_EQ(rig.device.requested_z_N, 0.75);
  EXPECT_DOUBLE_EQ(rig.device.requested_x_Nm, 0.01);
  EXPECT_DOUBLE_EQ(rig.device.requested_y_Nm, 0.02);
  EXPECT_DOUBLE_EQ(rig.device.requested_z_Nm, -0.03);
  EXPECT_EQ(rig.device.requested_gripper_N, 1.5);
  // the hand moves by 5 mm
  rig.device.intended_x_mm = 15;
  EXPECT_TRUE(soon([&] { return servo.last()[0].tip.x() > 14; }));
  rig.clock.stop = true;
  running.join();
  EXPECT_EQ(rig.device.force_N, 0);
  EXPECT_EQ(rig.device.brakes, 1);
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(ForceDimension, ReportsHeldMassAndCompensation) {
  FakeDhd& fake = fake_dhd();
  ForceDimensionSettings settings = fake_dhd_settings();
  settings.held_mass_kg = 0.19;
  settings.gravity = false;
  ForceDimensionDriver driver(settings);
  ASSERT_TRUE(driver.open(false).ok());
  EXPECT_EQ(fake.device[0].held_kg, 0.19);
  EXPECT_EQ(fake.device[0].gravity, 0);
}

TEST(ForceDimension, AnArmThatMovesNeedsConsent) {
  {
    DhdRig rig(35, false);
    rig.device.initialised = false;
    const auto refused = rig.driver->open(false);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().kind, ErrorKind::kUsage);
    EXPECT_EQ(rig.device.auto_inits, 0);
    EXPECT_EQ(rig.device.force_N, 0);
    ASSERT_TRUE(rig.driver->open(true).ok());
    EXPECT_EQ(rig.device.auto_inits, 1);
    EXPECT_TRUE(rig.driver->devices()[0].moves_by_itself);
    rig.begin();
    EXPECT_TRUE(rig.presses());
    rig.end();
    EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  }
  DhdRig stuck(35, false);
  stuck.device.initialised = false;
  stuck.fake.auto_init_fails = true;
  const auto failed = stuck.driver->open(true);
  ASSERT_FALSE(failed.ok());
  EXPECT_THAT(failed.error().what, HasSubstr("could not be initialised"));
  // the library's motion control has ended
  EXPECT_EQ(stuck.fake.violations, 0) << stuck.fake.first_violation.load();
}

TEST(ForceDimension, AFalconIsInitialisedByHandWhileTheSessionWaits) {
  DhdRig rig(60, false);
  rig.device.initialised = false;
  ASSERT_TRUE(rig.driver->open(false).ok());
  rig.begin();
  EXPECT_TRUE(rig.says("the position of the grip is not calibrated"));
  EXPECT_EQ(rig.device.force_N, 0);
  EXPECT_TRUE(rig.wall.fault);
  rig.device.initialised = true;
  EXPECT_TRUE(rig.presses());
  EXPECT_FALSE(rig.driver->failure());
  EXPECT_EQ(rig.device.auto_inits, 0);
}

TEST(ForceDimension, HaltGivesZerosUntilResume) {
  DhdRig rig;
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
}

// the device's own switch has precedence, whatever palpate was doing when it was pressed
TEST(ForceDimension, AHandThatSwitchesForcesOffDuringAHaltIsObeyed) {
  for (const int cause : {1, 5, 6}) {
    DhdRig rig;
    ASSERT_TRUE(rig.presses());
    rig.driver->halt();
    rig.device.trip = cause;
    ASSERT_TRUE(soon([&] { return rig.device.trip == 0; }));
    rig.driver->resume(0);
    EXPECT_TRUE(soon([&] { return rig.driver->failure().has_value(); })) << cause;
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    EXPECT_FALSE(rig.device.forces_on);
    EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
    rig.device.restored = true;
    EXPECT_TRUE(rig.presses()) << cause;
  }
}

// forces enabled by the operator during a halt are disabled again
TEST(ForceDimension, AHandThatSwitchesForcesOnDuringAHaltDoesNotEndIt) {
  DhdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.device.trip = 1;
  ASSERT_TRUE(rig.says("disabled at the device"));
  rig.driver->halt();
  rig.device.restored = true;
  ASSERT_TRUE(soon([&] { return !rig.device.restored; }));
  EXPECT_TRUE(soon([&] { return !rig.device.forces_on; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_FALSE(rig.device.forces_on);
  rig.driver->resume(0);
  EXPECT_TRUE(rig.presses());
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(ForceDimension, ForcesThatAreOffAtTheBeginningByAHandAreNotAskedFor) {
  DhdRig rig(33, false);
  rig.device.trip = 1;
  ASSERT_TRUE(rig.driver->open(false).ok());
  rig.begin();
  EXPECT_TRUE(rig.says("disabled at the device"));
  EXPECT_FALSE(rig.device.forces_on);
  rig.device.restored = true;
  EXPECT_TRUE(rig.presses());
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(ForceDimension, ForcesThatAreOffWithoutACauseAreNotAskedFor) {
  DhdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.device.trip = 9;
  ASSERT_TRUE(rig.says("without giving a reason"));
  std::this_thread::sleep_for(std::chrono::duration<double>(ForceDimensionDriver::kCalm_s + 0.1));
  EXPECT_FALSE(rig.device.forces_on);
  EXPECT_TRUE(rig.driver->failure().has_value());
}

TEST(ForceDimension, StopSendsZeroAndReadingContinues) {
  DhdRig rig;
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(rig.presses()) << round;
    rig.end();
    EXPECT_EQ(rig.device.force_N, 0);
    EXPECT_EQ(rig.device.requested_x_N, 0) << "asked for, and not the switch alone";
    EXPECT_FALSE(rig.device.forces_on);
    rig.begin();
  }
  EXPECT_TRUE(rig.presses());
}

TEST(ForceDimension, SeveralDevicesAreOfOneDriver) {
  FakeDhd& fake = fake_dhd();
  fake.count = 2;
  fake.device[0].type = 104;
  fake.device[1].type = 105;
  fake.device[1].left = true;
  fake.device[1].serial = 118;
  fake.device[1].intended_x_mm = -3;
  ForceDimensionDriver driver(fake_dhd_settings());
  ASSERT_TRUE(driver.open(false).ok());
  ASSERT_EQ(driver.devices().size(), 2u);
  EXPECT_EQ(driver.devices()[1].name, "sigma.7 (left) no. 118");
  DhdConstant servo;
  testing::UntilStopped clock;
  std::thread running([&] { driver.run(servo, clock); });
  EXPECT_TRUE(soon([&] { return fake.device[0].force_N > 0.9 && fake.device[1].force_N > 0.9; }));
  EXPECT_NEAR(servo.last()[0].tip.x(), 1.2, 0.2);
  EXPECT_NEAR(servo.last()[1].tip.x(), -3, 0.2);
  // a lost device is a fault of that device only
  fake.device[1].plugged = false;
  EXPECT_TRUE(soon([&] { return servo.last()[1].fault && driver.failure(); }));
  EXPECT_EQ(driver.failure()->where, "sigma.7 (left) no. 118");
  EXPECT_FALSE(servo.last()[0].fault);
  EXPECT_TRUE(soon([&] { return fake.device[0].force_N > 0.9; }));
  fake.device[1].plugged = true;
  EXPECT_TRUE(soon([&] { return fake.device[1].force_N > 0.9; }));
  clock.stop = true;
  running.join();
  EXPECT_EQ(fake.violations, 0) << fake.first_violation.load();
}

TEST(ForceDimension, InALoopNothingIsStrongerOrStifferThanItBears) {
  // the ball's surface is 12 mm to the right of the centre, along the device's y
  DhdRig rig(33, false);
  rig.device.intended_x_mm = 0;
  rig.device.intended_y_mm = testing::kBoneRadius_mm - 3;
  Parameters parameters;
  parameters.max_force_N = 30;
  auto loop = ServoLoop::start(std::make_shared<const Model>(testing::ball_model({1, 1, 1})), *rig.driver,
                               parameters, {WorkspaceSettings{}}, {.realtime = false, .ring_s = 10});
  ASSERT_TRUE(loop.ok()) << loop.error().message();
  EXPECT_TRUE(soon([&] { return rig.device.force_N > 0.1; }));
  const TickRecord tick = (*loop)->snapshot();
  EXPECT_EQ(tick.device[0].peak_force_N, 12);
  EXPECT_EQ(tick.device[0].max_stiffness_N_per_mm,
            conservative_bounds(rig.driver->devices()[0]).stiffness_N_per_mm);
  (*loop)->stop();
  EXPECT_LE(rig.device.largest_N, 6);
  EXPECT_EQ(rig.device.force_N, 0);
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(ForceDimension, OpenFailuresHaveReasonAndRemedy) {
  const auto refusal = [](ForceDimensionDriver& driver) {
    const auto opened = driver.open(false);
    EXPECT_FALSE(opened.ok());
    if (opened.ok()) return std::string();
    EXPECT_EQ(opened.error().kind, ErrorKind::kUnavailable);
    EXPECT_FALSE(opened.error().remedy.empty()) << opened.error().what;
    return opened.error().message();
  };
  FakeDhd& fake = fake_dhd();
  ForceDimensionDriver driver(fake_dhd_settings());
  fake.count = 0;
  EXPECT_THAT(refusal(driver), HasSubstr("no device is connected"));
  fake.count = 1;
  fake.device[0].in_use = true;
  EXPECT_THAT(refusal(driver), HasSubstr("cannot be opened (device in use)"));
  fake.device[0].in_use = false;
  EXPECT_TRUE(driver.open(false).ok());
  EXPECT_TRUE(driver.open(false).ok()) << "again";
  EXPECT_EQ(fake.device[0].opened, 1);

  ForceDimensionSettings settings;
  settings.library.file = "/no/such/libdrd.so.3";
  ForceDimensionDriver nothing(settings);
  EXPECT_THAT(refusal(nothing), HasSubstr("/no/such/libdrd.so.3: there is no such file"));
  const test::TemporaryFolder empty;
  settings.library.file.clear();
  settings.library.folders = {empty.path()};
  ForceDimensionDriver nowhere(settings);
  EXPECT_THAT(refusal(nowhere), HasSubstr("no libdrd.so.3 or libdrd.so or libdhd.so.3 or libdhd.so is in " +
                                          empty.path().string()));
  settings.library.file = std::string(PALPATE_SOURCE_DIR) + "/CMakeLists.txt";
  ForceDimensionDriver no_library(settings);
  EXPECT_THAT(refusal(no_library), HasSubstr("cannot be loaded"));
  // missing functions are listed
  ForceDimensionDriver too_old(fake_dhd_settings(PALPATE_FAKE_OLD_DHD));
  EXPECT_THAT(refusal(too_old), HasSubstr("does not have dhdHasActiveGripper, dhdIsLeftHanded\n"));
}

TEST(ForceDimension, IsFoundInAFolder) {
  const test::TemporaryFolder folder, other;
  std::filesystem::create_symlink(PALPATE_FAKE_DRD, folder.path() / "libdrd.so.3");
  fake_dhd();
  ForceDimensionSettings settings;
  settings.library.folders = {other.path()};
  EXPECT_FALSE(ForceDimensionDriver(settings).open(false).ok());
  settings.library.folders.push_back(folder.path());
  EXPECT_TRUE(ForceDimensionDriver(settings).open(false).ok());
}

TEST(ForceDimension, WithoutLibdrdAnArmHasToBeInitialisedAlready) {
  FakeDhd& fake = fake_dhd(PALPATE_FAKE_DHD);
  fake.device[0].initialised = false;
  ForceDimensionDriver driver(fake_dhd_settings(PALPATE_FAKE_DHD));
  const auto refused = driver.open(true);
  ASSERT_FALSE(refused.ok());
  EXPECT_THAT(refused.error().what, HasSubstr("not initialised"));
  fake.device[0].initialised = true;
  EXPECT_TRUE(driver.open(false).ok());
}

TEST(ForceDimension, IsLookedForWithoutMovingAnything) {
  FakeDhd& fake = fake_dhd();
  fake.count = 2;
  fake.device[0].initialised = false;
  fake.device[1].type = 60;
  const DeviceVendor vendor = force_dimension_vendor(fake_dhd_settings());
  EXPECT_EQ(vendor.name, "force-dimension");
  DeviceReport report = vendor.detect();
  ASSERT_EQ(report.connected.size(), 2u);
  EXPECT_EQ(report.connected[0].id, "omega.3 no. 117");
  EXPECT_THAT(report.connected[0].state, HasSubstr("not initialised"));
  EXPECT_EQ(report.connected[1].state, "ready");
  ASSERT_EQ(report.checks.size(), 3u);
  EXPECT_THAT(report.checks[0].found, HasSubstr("version 3.17.6"));
  for (const DeviceCheck& check : report.checks) EXPECT_EQ(check.remedy.empty(), check.passed) << check.what;
  EXPECT_EQ(fake.device[0].auto_inits, 0);
  EXPECT_EQ(fake.device[0].forces, 0u);
  EXPECT_FALSE(fake.device[0].forces_on);
  EXPECT_EQ(fake.violations, 0) << fake.first_violation.load();

  fake.count = 0;
  report = vendor.detect();
  EXPECT_TRUE(report.connected.empty());
  EXPECT_FALSE(report.checks.back().passed);
  EXPECT_FALSE(report.checks.back().remedy.empty());
}

}  // namespace
}  // namespace palpate
