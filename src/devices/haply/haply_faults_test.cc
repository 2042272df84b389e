#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <functional>
#include <random>
#include <string>
#include <thread>

#include "base/test_seed.h"
#include "haply/test_haply_rig.h"

/// The driver under faults: the force is removed first, then the fault is reported, then the session
/// continues.
namespace palpate {
namespace {

using testing::FakeInverseService;
using testing::haply_faults;
using testing::HaplyFault;
using testing::HaplyRig;
using testing::soon;

class HaplyFaults : public ::testing::TestWithParam<HaplyFault> {};
INSTANTIATE_TEST_SUITE_P(Each, HaplyFaults, ::testing::ValuesIn(haply_faults()),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST_P(HaplyFaults, ForceIsZeroedReportedAndRestored) {
  HaplyRig rig;
  ASSERT_TRUE(rig.presses());
  GetParam().begin(rig.service);
  EXPECT_TRUE(soon([&] { return rig.service.force_N() == 0; }));
  EXPECT_TRUE(rig.says(GetParam().words)) << rig.declared();
  // without force, but the servo keeps running
  const int updates = rig.wall.updates;
  EXPECT_TRUE(soon([&] { return rig.wall.updates > updates + 20; }));
  EXPECT_EQ(rig.service.force_N(), 0);
  GetParam().end(rig.service);
  EXPECT_TRUE(rig.presses()) << rig.declared();
  EXPECT_TRUE(soon([&] { return !rig.driver->failure(); }));
  rig.end();
  EXPECT_TRUE(soon([&] { return rig.service.force_N() == 0; }));
  EXPECT_EQ(rig.service.violations(), 0);
}

TEST(HaplyFaults, ReconnectsAutomatically) {
  HaplyRig rig;
  ASSERT_TRUE(rig.presses());
  const int before = rig.service.connections();
  rig.service.close_connections();
  EXPECT_TRUE(soon([&] { return rig.service.connections() > before; }));
  EXPECT_TRUE(rig.presses());
  EXPECT_TRUE(soon([&] { return !rig.driver->failure(); }));
}

// zero force is requested from a silent service before it is given up
TEST(HaplyFaults, SilentServiceGetsZeroForce) {
  HaplyRig rig;
  ASSERT_TRUE(rig.presses());
  rig.service.silent = true;
  const std::size_t then = rig.service.delivered().size();
  const int before = rig.service.connections();
  const auto zero_is_reported = [&] {
    const auto supplied = rig.service.delivered();
    return std::any_of(
        supplied.begin() + static_cast<std::ptrdiff_t>(then), supplied.end(),
        [](const auto& each) { return !each.idle && each.command.force_N == Vector<Device>(); });
  };
  // if the machine stalled, it may be a new connection that starts with zero
  EXPECT_TRUE(soon([&] { return zero_is_reported(); }));
  if (rig.service.connections() == before) {
    // after a command in flight there is no further one with force
    const auto input = rig.service.delivered();
    for (std::size_t n = then + 2; n < input.size(); ++n)
      EXPECT_EQ(input[n].command.force_N, Vector<Device>());
  }
  rig.service.silent = false;
  EXPECT_TRUE(rig.presses());
}

// from 3.5 on the service reports events of the device
TEST(HaplyFaults, ABrakeIsAFaultForAMoment) {
  HaplyRig rig("3.5.0");
  ASSERT_TRUE(rig.presses());
  ASSERT_TRUE(soon([&] { return rig.service.event_listeners() > 0; }));
  rig.service.report_event(R"({"event":"device-safety-triggered","cause":"stall_detected"})");
  rig.service.report_event("{ no event");
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_TRUE(rig.presses());
  rig.service.report_event(R"({"event":"device-safety-triggered","cause":"ebrake_triggered"})");
  EXPECT_TRUE(soon([&] { return rig.wall.fault && rig.service.force_N() == 0; }));
  EXPECT_TRUE(rig.says("brake")) << rig.declared();
  EXPECT_TRUE(rig.presses()) << "and is over";
  rig.end();
  EXPECT_EQ(rig.service.violations(), 0);
}

TEST(HaplyFaults, NamesUnknownVersions) {
  HaplyRig rig;
  ASSERT_TRUE(rig.presses());
  rig.service.stop();
  rig.service.start("4.2.0");
  EXPECT_TRUE(rig.says("version"));
  rig.service.stop();
  rig.service.start("3.0.0");
  EXPECT_TRUE(rig.presses());
}

// the force never exceeds the wall's. PALPATE_TEST_FAULTS=200 sets their number
TEST(HaplyFaults, SurvivesAnySequenceOfFaults) {
  HaplyRig rig;
  testing::outlive_any(rig, rig.service, haply_faults(), 20, [&](std::mt19937& random) {
    if (random() % 3 == 0) rig.service.close_connections();
  });
  EXPECT_EQ(rig.service.violations(), 0);
  for (const testing::Delivery& delivery : rig.service.delivered())
    ASSERT_LE(delivery.command.force_N.norm(), testing::kWall_N_per_mm * 4 * testing::kWallIntended_mm);
}

/// Difference between the actual and the declared age of states, for those that generate force.
class Ages final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    const DeviceSample& sample = samples[0];
    commands[0].force_N = Vector<Device>(0, 0, sample.fault ? 0 : 1);
    ++updates;
    if (sample.fault || sample.taken_ns == last_ns_) return;
    last_ns_ = sample.taken_ns;
    const double declared_ms = 1e-6 * static_cast<double>(sample.taken_ns % FakeInverseService::kEra_ns);
    // the encoded time begins again at the end of each era
    constexpr double kEra_ms = 1e-6 * static_cast<double>(FakeInverseService::kEra_ns);
    max_ms = std::max(max_ms.load(), std::remainder(declared_ms - sample.tip.z(), kEra_ms));
    ++fresh;
  }
  std::atomic<int> updates{0}, fresh{0};
  std::atomic<double> max_ms{0};

 private:
  std::int64_t last_ns_ = 0;
};

// allowance for the transport of a state through a local socket
constexpr double kTransport_ms = 1;

/// Against a service whose pace differs from the driver's.
class HaplyPace : public ::testing::Test {
 protected:
  HaplyPace() : service_(testing::haply_hand()), driver_(service_.settings()) {
    service_.encodes_time = true;
    EXPECT_TRUE(driver_.open(false).ok());
    thread_ = std::thread([this] { driver_.run(ages_, clock_); });
  }
  ~HaplyPace() override {
    clock_.stop = true;
    thread_.join();
  }
  void wait_ms(int ms) { std::this_thread::sleep_for(std::chrono::milliseconds(ms)); }
  bool becomes_fresh() {
    const auto fresh = [this, then = ages_.fresh.load()] { return ages_.fresh > then + 100; };
    // a pace is adopted once it has been sustained, which takes longer on a loaded machine
    return soon(fresh) || soon(fresh) || soon(fresh);
  }

  void expect_no_state_is_older_than_said() {
    EXPECT_LT(ages_.max_ms, kTransport_ms + service_.max_late_ms());
  }

  FakeInverseService service_;
  HaplyDriver driver_;
  Ages ages_;
  testing::UntilStopped clock_;
  std::thread thread_;
};

TEST_F(HaplyPace, UnrequestedStateIsNoOlderThanItsReportedAge) {
  for (const double hz : {300.0, 2000.0, 8000.0}) {
    service_.pushes_hz = hz;
    wait_ms(300);
    EXPECT_TRUE(becomes_fresh()) << "one that pushes fresh states stays usable at " << hz << " Hz";
  }
  service_.pushes_hz = 0;
  for (const int each : {2, 5}) {
    service_.answers_each = each;
    wait_ms(300);
    EXPECT_TRUE(becomes_fresh()) << each << " answers to each request";
  }
  expect_no_state_is_older_than_said();
}

TEST_F(HaplyPace, AQueueOfOldStatesGivesNoForceUntilItIsEmpty) {
  service_.pushes_hz = 5000;
  for (int n = 0; n < 5; ++n) {
    service_.withholds_states = true;
    wait_ms(150);
    service_.withholds_states = false;
    wait_ms(100);
    EXPECT_TRUE(becomes_fresh());
  }
  expect_no_state_is_older_than_said();
}

TEST_F(HaplyPace, FloodingServiceIsReportedAndGetsZeroForce) {
  service_.answers_each = 3000;
  EXPECT_TRUE(soon([&] {
    return driver_.failure() && driver_.failure()->what.find("may be outdated") != std::string::npos;
  }));
  EXPECT_TRUE(soon([&] { return service_.force_N() == 0; }));
  service_.answers_each = 1;
  EXPECT_TRUE(becomes_fresh());
  EXPECT_TRUE(soon([&] { return !driver_.failure(); }));
  expect_no_state_is_older_than_said();
}

// PALPATE_TEST_SCHEDULES=10000 sets their number
TEST_F(HaplyPace, ReportedAgeIsAnUpperBoundForAnySchedule) {
  const char* value = std::getenv("PALPATE_TEST_SCHEDULES");
  const int schedules = value != nullptr ? std::atoi(value) : 60;
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int n = 0; n < schedules; ++n) {
    constexpr std::array kPaces_hz{0.0, 0.0, 250.0, 1000.0, 4000.0, 10'000.0};
    constexpr std::array kEach{1, 1, 1, 2, 7, 300};
    service_.pushes_hz = kPaces_hz[random() % kPaces_hz.size()];
    service_.answers_each = kEach[random() % kEach.size()];
    service_.withholds_states = random() % 3 == 0;
    service_.silent = random() % 5 == 0;
    wait_ms(static_cast<int>(1 + random() % 40));
  }
  service_.pushes_hz = 0;
  service_.answers_each = 1;
  service_.withholds_states = service_.silent = false;
  EXPECT_TRUE(becomes_fresh());
  expect_no_state_is_older_than_said();
}

// sends a constant force indefinitely
class Pushing final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> /*samples*/,
              std::span<DeviceCommand> commands) noexcept override {
    commands[0].force_N = Vector<Device>(0, 0, 1);
  }
};

// When the program dies for any reason, its connection is closed and the device goes idle.
TEST(HaplyFaults, AProgramThatDiesLeavesNoForce) {
  for (const int signal : {SIGKILL, SIGTERM, SIGSEGV, SIGABRT}) {
    std::array<int, 2> pipe{};
    ASSERT_EQ(::pipe(pipe.data()), 0);
    // fork before any thread is started
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      HaplySettings settings;
      ::close(pipe[1]);
      if (::read(pipe[0], &settings.port, sizeof settings.port) != sizeof settings.port ||
          ::read(pipe[0], &settings.old_http_port, sizeof settings.old_http_port) <= 0)
        ::_exit(1);
      std::signal(signal, SIG_DFL);
      HaplyDriver driver(settings);
      Pushing pushing;
      testing::UntilStopped never;
      if (driver.open(false)) driver.run(pushing, never);
      ::_exit(1);
    }
    {
      FakeInverseService service(testing::haply_hand());
      const HaplySettings settings = service.settings();
      EXPECT_EQ(::write(pipe[1], &settings.port, sizeof settings.port), 2);
      EXPECT_EQ(::write(pipe[1], &settings.old_http_port, sizeof settings.old_http_port), 2);
      EXPECT_TRUE(soon([&] { return service.force_N() == 1; }));
      EXPECT_EQ(::kill(child, signal), 0);
      EXPECT_TRUE(soon([&] { return service.force_N() == 0; })) << signal;
    }
    int status = 0;
    EXPECT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFSIGNALED(status)) << signal;
    ::close(pipe[0]);
    ::close(pipe[1]);
  }
}

// destroyed at a random time
TEST(HaplyFaults, MayEndAtAnyMoment) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int n = 0; n < 6; ++n) {
    HaplyRig rig;
    const HaplyFault& fault = haply_faults()[random() % haply_faults().size()];
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 20));
    fault.begin(rig.service);
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 150));
    rig.end();
    EXPECT_TRUE(soon([&] { return rig.service.force_N() == 0; })) << fault.name;
  }
}

}  // namespace
}  // namespace palpate
