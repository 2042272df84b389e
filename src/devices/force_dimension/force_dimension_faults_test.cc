#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "force_dimension/test_dhd_rig.h"

/// The driver under faults: the force is removed first, then the fault is reported, then the session
/// continues.
namespace palpate {
namespace {

using testing::DhdRig;
using testing::FakeDhdDevice;
using testing::soon;

using testing::dhd_faults;
using testing::DhdFault;

class DhdFaults : public ::testing::TestWithParam<DhdFault> {};
INSTANTIATE_TEST_SUITE_P(Each, DhdFaults, ::testing::ValuesIn(dhd_faults()), [](const auto& tested) {
  std::string name = tested.param.name;
  std::ranges::replace(name, ' ', '_');
  return name;
});

TEST_P(DhdFaults, ForceIsZeroedReportedAndRestored) {
  // a device with orientation
  DhdRig rig(35);
  ASSERT_TRUE(rig.presses());
  GetParam().begin(rig.device);
  EXPECT_TRUE(soon([&] { return rig.wall.fault && rig.device.force_N == 0; }));
  EXPECT_TRUE(rig.says(GetParam().words)) << rig.declared();
  const int then = rig.wall.updates;
  EXPECT_TRUE(soon([&] { return rig.wall.updates > then + 20; })) << "the session goes on";
  EXPECT_EQ(rig.device.force_N, 0);
  // gravity compensation ends as well. A device that cannot be reached releases by its own watchdog
  const bool is_reached = rig.device.plugged && !rig.device.fails;
  EXPECT_TRUE(!is_reached || soon([&] { return !rig.device.forces_on; }));
  GetParam().end(rig.device);
  EXPECT_TRUE(rig.presses()) << rig.declared();
  EXPECT_TRUE(soon([&] { return !rig.driver->failure(); }));
  rig.end();
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

// not a fault: the state ages, and the output stage handles that
TEST(DhdFaultsAlone, OldStatesAge) {
  DhdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.device.old = true;
  EXPECT_TRUE(soon([&] { return rig.device.force_N == 0; }));
  EXPECT_FALSE(rig.wall.fault);
  const std::int64_t taken_ns = rig.wall.taken_ns;
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_EQ(rig.wall.taken_ns, taken_ns);
  rig.device.old = false;
  EXPECT_TRUE(rig.presses());
  rig.device.saturated = true;
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_TRUE(rig.presses()) << "motors that give less are no fault";
}

// forces that the device disabled by itself are not enabled while it moves, or may be moving
TEST(DhdFaultsAlone, AfterAVelocityTripItHasToBeHeldStill) {
  const auto calm = std::chrono::duration<double>(ForceDimensionDriver::kCalm_s);
  for (const double velocity_m_s : {0.06, std::nan("")}) {
    DhdRig rig;
    ASSERT_TRUE(rig.presses());
    rig.device.velocity_y_m_s = velocity_m_s;
    rig.device.says_velocity = true;
    rig.device.trip = 2;
    ASSERT_TRUE(soon([&] { return rig.device.force_N == 0; }));
    std::this_thread::sleep_for(calm + std::chrono::milliseconds(200));
    EXPECT_EQ(rig.device.force_N, 0) << velocity_m_s;
    EXPECT_FALSE(rig.device.forces_on);
    const auto still = std::chrono::steady_clock::now();
    rig.device.velocity_y_m_s = 0.04;
    ASSERT_TRUE(rig.presses());
    // the last status query was at most 4 ms earlier
    EXPECT_GE(std::chrono::steady_clock::now() - still, calm - std::chrono::milliseconds(20));
  }
}

// motors keep the last commanded force
TEST(DhdFaultsAlone, OneThatDoesNotHearForcesIsSwitchedOff) {
  DhdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.device.deaf = true;
  EXPECT_TRUE(soon([&] { return rig.device.force_N == 0 && !rig.device.forces_on; }));
  // it is reopened repeatedly, without ever exerting force
  std::atomic<double> max_N{0};
  const int opened = rig.device.opened;
  EXPECT_TRUE(soon([&] {
    max_N = std::max(max_N.load(), rig.device.force_N.load());
    return rig.device.opened > opened + 1;
  }));
  EXPECT_EQ(max_N, 0);
  rig.device.deaf = false;
  EXPECT_TRUE(rig.presses());
  rig.end();
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

TEST(DhdFaultsAlone, RejectsAReplacedDeviceByName) {
  DhdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.device.plugged = false;
  ASSERT_TRUE(rig.says("disconnected"));
  rig.device.serial = 99;
  rig.device.plugged = true;
  EXPECT_TRUE(rig.says("a different device"));
  EXPECT_EQ(rig.device.force_N, 0);
  rig.device.plugged = false;
  rig.device.serial = 117;
  rig.device.plugged = true;
  EXPECT_TRUE(rig.presses());
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

// a device that returns uninitialised is closed, so that the vendor's program can open it
TEST(DhdFaultsAlone, ArmIsNotMovedDuringASession) {
  DhdRig rig(35, false);
  rig.device.initialised = false;
  ASSERT_TRUE(rig.driver->open(true).ok());
  rig.begin();
  ASSERT_TRUE(rig.presses());
  rig.device.plugged = false;
  rig.device.initialised = false;
  ASSERT_TRUE(rig.says("disconnected"));
  rig.device.plugged = true;
  EXPECT_TRUE(rig.says("not initialised"));
  EXPECT_EQ(rig.device.auto_inits, 1);
  rig.device.initialised = true;
  EXPECT_TRUE(rig.presses());
}

// the force never exceeds the wall's. PALPATE_TEST_FAULTS=200 sets their number
TEST(DhdFaultsAlone, SurvivesAnySequenceOfFaults) {
  DhdRig rig(35);
  testing::outlive_any(rig, rig.device, dhd_faults(), 6);
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  EXPECT_LE(rig.device.largest_N, testing::kWall_N_per_mm * 4 * testing::kWallIntended_mm);
}

// destroyed at a random time
TEST(DhdFaultsAlone, MayEndAtAnyMoment) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int n = 0; n < 6; ++n) {
    DhdRig rig(35);
    const DhdFault& fault = dhd_faults()[random() % dhd_faults().size()];
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 20));
    fault.begin(rig.device);
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 150));
    rig.end();
    // before it is closed. A device that cannot be reached releases by its own watchdog
    const bool is_reached = rig.device.plugged && !rig.device.fails;
    EXPECT_TRUE(!is_reached || rig.device.force_N == 0) << fault.name;
    rig.driver.reset();
    EXPECT_EQ(rig.fake.violations, 0) << fault.name << ": " << rig.fake.first_violation.load();
  }
}

}  // namespace
}  // namespace palpate
