#include <gtest/gtest.h>

#include <cstdlib>
#include <functional>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "openhaptics/test_hd_rig.h"

/// The driver when something breaks: no force first, then words, then on with it.
namespace palpate {
namespace {

using testing::FakeHd;
using testing::HdRig;
using testing::soon;

struct HdFault {
  const char* name;
  std::function<void(FakeHd&)> begin, end;
  const char* words;
};

const std::vector<HdFault>& hd_faults() {
  const auto flag = [](const char* name, std::atomic<bool> testing::FakeHdDevice::*member, bool faulty,
                       const char* words) {
    return HdFault{name, [=](FakeHd& fake) { fake.device[0].*member = faulty; },
                   [=](FakeHd& fake) { fake.device[0].*member = !faulty; }, words};
  };
  const auto error = [](const char* name, unsigned code, const char* words) {
    return HdFault{name, [=](FakeHd& fake) { fake.device[0].error = code; }, [](FakeHd&) {}, words};
  };
  static const std::vector<HdFault> faults{
      flag("unplugged", &testing::FakeHdDevice::plugged, false, "not reach"),
      flag("communication", &testing::FakeHdDevice::communication, false, "not reach"),
      flag("nowhere", &testing::FakeHdDevice::nowhere, true, "a place that is none"),
      flag("crooked", &testing::FakeHdDevice::crooked, true, "a place that is none"),
      flag("mute", &testing::FakeHdDevice::mute, true, "a place that is none"),
      flag("calibration", &testing::FakeHdDevice::never_calibrates, true, "not calibrated"),
      error("warm", 0x200, "motors are warm"),
      error("force", 0x201, "force was too high"),
      error("impulse", 0x202, "force was too high"),
      error("velocity", 0x203, "faster than it allows"),
      error("forceError", 0x204, "force was too high"),
      error("deviceFault", 0x300, "not reach"),
      error("timer", 0x304, "not reach"),
      {"stalled", [](FakeHd& fake) { fake.stalled = true; }, [](FakeHd& fake) { fake.stalled = false; },
       "stands still"},
  };
  return faults;
}

class HdFaults : public ::testing::TestWithParam<HdFault> {};
INSTANTIATE_TEST_SUITE_P(Each, HdFaults, ::testing::ValuesIn(hd_faults()),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST_P(HdFaults, TakeTheForceThenSayWhyAndAreOver) {
  HdRig rig;
  ASSERT_TRUE(rig.presses());
  // said and over within a moment, some of them
  std::atomic<bool> said{false}, done{false};
  std::thread listening([&] {
    while (!done && !said) {
      const auto trouble = rig.driver->trouble();
      said = trouble && trouble->what.find(GetParam().words) != std::string::npos && !trouble->remedy.empty();
    }
  });
  GetParam().begin(rig.fake);
  EXPECT_TRUE(soon([&] { return rig.device.force_N == 0; }));
  EXPECT_TRUE(soon([&] { return said.load(); }));
  done = true;
  listening.join();
  const int then = rig.wall.updates;
  EXPECT_TRUE(soon([&] { return rig.wall.updates > then + 20; })) << "the session goes on";
  GetParam().end(rig.fake);
  EXPECT_TRUE(rig.presses()) << (rig.driver->trouble() ? rig.driver->trouble()->what : "nothing");
  EXPECT_TRUE(soon([&] { return !rig.driver->trouble(); }));
  rig.end();
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  EXPECT_FALSE(rig.wall.twice_at_once);
}

TEST(HdFaultsAlone, AnotherDeviceByTheNameIsNotFelt) {
  HdRig rig;
  ASSERT_TRUE(rig.presses());
  rig.device.plugged = false;
  ASSERT_TRUE(rig.says("not reach"));
  rig.device.serial = "another";
  rig.device.plugged = true;
  EXPECT_TRUE(rig.says("another device"));
  EXPECT_EQ(rig.device.force_N, 0);
  rig.device.serial = "4711";
  EXPECT_TRUE(rig.presses());
  rig.end();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
}

// its thread is left alone in there, and finds nothing to do when it comes back
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
  EXPECT_EQ(rig.device.asked_x_N, 0);
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
  // frames go on meanwhile, with zeros
  EXPECT_EQ(rig.device.force_N, 0);
  const int then = rig.wall.updates;
  rig.driver->run(rig.wall, rig.clock);
  rig.driver.reset();
  EXPECT_LT(monotonic_ns() - since_ns, std::int64_t{20'000'000'000}) << "a second, on a machine with time";
  EXPECT_TRUE(rig.fake.running);
  rig.fake.stop_hangs = false;
  // the next session finds the library as it was
  EXPECT_TRUE(soon([&] { return !rig.fake.running && !rig.fake.scheduled; }));
  EXPECT_EQ(rig.wall.updates, then);
  EXPECT_EQ(rig.device.force_N, 0);
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  rig.fake.reset();
}

// any faults, one after another and together: no force while there is one, none above the wall's, and it is
// felt again when all is well. PALPATE_TEST_FAULTS=200 takes that many.
TEST(HdFaultsAlone, AnySequenceOfThemIsOutlived) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  const char* asked = std::getenv("PALPATE_TEST_FAULTS");
  const int sequences = asked ? std::atoi(asked) : 6;
  std::mt19937 random(seed);
  HdRig rig;
  for (int n = 0; n < sequences; ++n) {
    SCOPED_TRACE("sequence " + std::to_string(n));
    ASSERT_TRUE(rig.presses()) << (rig.driver->trouble() ? rig.driver->trouble()->what : "nothing");
    std::vector<const HdFault*> there;
    for (unsigned step = 1 + random() % 4; step > 0; --step) {
      const HdFault& fault = hd_faults()[random() % hd_faults().size()];
      fault.begin(rig.fake);
      there.push_back(&fault);
      std::this_thread::sleep_for(std::chrono::milliseconds(random() % 30));
      if (random() % 4 == 0) rig.driver->halt();
    }
    ASSERT_TRUE(soon([&] { return rig.device.force_N == 0; }));
    while (!there.empty()) {
      const std::size_t next = random() % there.size();
      there[next]->end(rig.fake);
      there.erase(there.begin() + static_cast<std::ptrdiff_t>(next));
    }
    rig.driver->resume(0);
  }
  ASSERT_TRUE(rig.presses());
  rig.end();
  EXPECT_EQ(rig.device.force_N, 0);
  rig.driver.reset();
  EXPECT_EQ(rig.fake.violations, 0) << rig.fake.first_violation.load();
  EXPECT_FALSE(rig.wall.twice_at_once);
  EXPECT_LE(rig.device.largest_N, testing::kWall_N_per_mm * 4 * testing::kWallIntended_mm);
}

// ended in the middle of whatever it does
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
    // before it is disabled, which takes the force as well
    EXPECT_TRUE(rig.device.force_N == 0) << fault.name;
    rig.driver.reset();
    EXPECT_FALSE(rig.fake.running);
    EXPECT_EQ(rig.fake.violations, 0) << fault.name << ": " << rig.fake.first_violation.load();
  }
}

}  // namespace
}  // namespace palpate
