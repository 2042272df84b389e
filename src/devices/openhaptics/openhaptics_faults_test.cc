#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "openhaptics/test_hd_rig.h"

/// The driver under faults: the force is removed first, then the fault is reported, then the session
/// continues.
namespace palpate {
namespace {

using testing::FakeHd;
using testing::hd_faults;
using testing::hd_faults_and_hang;
using testing::HdFault;
using testing::HdRig;
using testing::soon;

class HdFaults : public ::testing::TestWithParam<HdFault> {};
INSTANTIATE_TEST_SUITE_P(Each, HdFaults, ::testing::ValuesIn(hd_faults_and_hang()), [](const auto& tested) {
  std::string name = tested.param.name;
  std::ranges::replace(name, ' ', '_');
  return name;
});

TEST_P(HdFaults, ForceIsZeroedReportedAndRestored) {
  HdRig rig;
  ASSERT_TRUE(rig.presses());
  // some faults are reported and over within a moment
  std::atomic<bool> declared{false}, done{false};
  std::thread listening([&] {
    while (!done && !declared) {
      const auto failure = rig.driver->failure();
      declared =
          failure && failure->what.find(GetParam().words) != std::string::npos && !failure->remedy.empty();
    }
  });
  GetParam().begin(rig.fake);
  EXPECT_TRUE(soon([&] { return rig.device.force_N == 0; }));
  EXPECT_TRUE(soon([&] { return declared.load(); }));
  done = true;
  listening.join();
  const int then = rig.wall.updates;
  EXPECT_TRUE(soon([&] { return rig.wall.updates > then + 20; })) << "the session goes on";
  GetParam().end(rig.fake);
  EXPECT_TRUE(rig.presses()) << rig.declared();
  EXPECT_TRUE(soon([&] { return !rig.driver->failure(); }));
  rig.end();
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  EXPECT_FALSE(rig.wall.twice_at_once);
}

// also if the frame with the error is late, and run() already ticks
TEST(HdFaultsAlone, ReinitialisesAfterAFailure) {
  for (const int late_ms : {0, 5, 9, 12, 30}) {
    SCOPED_TRACE(late_ms);
    HdRig rig;
    ASSERT_TRUE(rig.presses());
    const int before = rig.device.inits;
    rig.fake.hangs = late_ms > 0;
    rig.device.error = 0x300;
    std::this_thread::sleep_for(std::chrono::milliseconds(late_ms));
    rig.fake.hangs = false;
    EXPECT_TRUE(soon([&] { return rig.device.inits > before; }));
    EXPECT_TRUE(rig.presses()) << rig.declared();
  }
}

TEST(HdFaultsAlone, RejectsAnotherDeviceOfTheSameName) {
  HdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.device.plugged = false;
  ASSERT_TRUE(rig.says("has lost the device"));
  rig.device.serial = "another";
  rig.device.plugged = true;
  EXPECT_TRUE(rig.says("a different device"));
  EXPECT_EQ(rig.device.force_N, 0);
  rig.device.serial = "4711";
  EXPECT_TRUE(rig.presses());
  rig.end();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

// its thread is abandoned, and finds nothing to do when it returns
TEST(HdFaultsAlone, ALibraryThatHangsDoesNotKeepTheEnd) {
  HdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.fake.hangs = true;
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_EQ(rig.device.force_N, 0) << "switched off, for no frame has ended";
  rig.end();
  rig.driver->run(rig.wall, rig.clock);
  rig.driver.reset();
  const int then = rig.wall.updates;
  const std::uint64_t frames = rig.device.frames;
  rig.fake.hangs = false;
  EXPECT_TRUE(soon([&] { return rig.device.frames > frames; }));
  EXPECT_EQ(rig.wall.updates, then);
  EXPECT_EQ(rig.device.requested_x_N, 0);
  EXPECT_EQ(rig.device.force_N, 0);
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  // its thread has to have ended
  rig.fake.reset();
}

TEST(HdFaultsAlone, AStopThatHangsDoesNotKeepTheEnd) {
  HdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.fake.stop_hangs = true;
  const std::int64_t since_ns = monotonic_ns();
  rig.end();
  // frames continue meanwhile, with zeros
  EXPECT_EQ(rig.device.force_N, 0);
  const int then = rig.wall.updates;
  rig.driver->run(rig.wall, rig.clock);
  rig.driver.reset();
  EXPECT_LT(monotonic_ns() - since_ns, std::int64_t{20'000'000'000}) << "a second, on a machine with time";
  EXPECT_TRUE(rig.fake.running);
  rig.fake.stop_hangs = false;
  // the library is available to the next session
  EXPECT_TRUE(soon([&] { return !rig.fake.running && !rig.fake.scheduled; }));
  EXPECT_EQ(rig.wall.updates, then);
  EXPECT_EQ(rig.device.force_N, 0);
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  rig.fake.reset();
}

// the force never exceeds the wall's. PALPATE_TEST_FAULTS=200 sets their number
TEST(HdFaultsAlone, SurvivesAnySequenceOfFaults) {
  HdRig rig;
  testing::outlive_any(rig, rig.fake, hd_faults_and_hang(), 6);
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  EXPECT_LE(rig.device.largest_N, testing::kWall_N_per_mm * 4 * testing::kWallIntended_mm);
}

// destroyed at a random time
TEST(HdFaultsAlone, MayEndAtAnyMoment) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int n = 0; n < 6; ++n) {
    HdRig rig;
    const HdFault& fault = hd_faults()[random() % hd_faults().size()];
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 20));
    fault.begin(rig.fake);
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 150));
    rig.end();
    // before the device is disabled, which removes the force as well
    EXPECT_TRUE(rig.device.force_N == 0) << fault.name;
    rig.driver.reset();
    EXPECT_FALSE(rig.fake.running);
    EXPECT_EQ(rig.fake.violations, 0) << fault.name << ": " << rig.fake.first_violation.load();
  }
}

}  // namespace
}  // namespace palpate
