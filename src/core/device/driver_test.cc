#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>

#include "base/test_wait.h"
#include "device/test_drivers.h"
#include "palpate/base/clock.h"

/// Contract tests of the device port, applied to one driver of each kind.
namespace palpate {
namespace {

using testing::CallbackDriver;
using testing::Delivery;
using testing::ExchangeDriver;
using testing::FakePeer;
using testing::FakeVendor;
using testing::soon;
using testing::TestClock;

// a hand and device that settle within 20 ms: critically damped, 316 rad/s
constexpr double kHand_N_per_mm = 2;
const PlantDevice kLight{"light", 0.01, 0, 0, 0, 1e9, 1e9};
const PlantHand kStill{"still", 0.01, 12.6, kHand_N_per_mm * 1000};

// a wall at x = 0, soft enough for any delay of a busy machine
constexpr double kWall_N_per_mm = 1;
DeviceCommand wall(const DeviceSample& sample) {
  return {Vector<Device>(-kWall_N_per_mm * std::max(0.0, sample.tip.x()), 0, 0), {}};
}

// the servo of every test: the wall, and the last sample
class Wall final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    if (samples.size() != 1 || commands.size() != 1) std::abort();
    if (!thread_) thread_ = std::this_thread::get_id();
    if (*thread_ != std::this_thread::get_id()) one_thread_ = false;
    while (hangs_) std::this_thread::yield();
    commands[0] = wall(samples[0]);
    const bool new_and_still =
        samples[0].taken_ns > taken_ns_ && std::abs(samples[0].tip.x() - tip_x_mm_) < 1e-4;
    still_ = new_and_still ? still_ + 1 : 0;
    tip_x_mm_ = samples[0].tip.x();
    taken_ns_ = samples[0].taken_ns;
    age_ns_ = monotonic_ns() - samples[0].taken_ns;
    ++updates_;
  }
  void hang(bool on) { hangs_ = on; }
  int updates() const { return updates_; }
  // Number of samples since the tip last moved
  int still() const { return still_; }
  double tip_x_mm() const { return tip_x_mm_; }
  std::int64_t taken_ns() const { return taken_ns_; }
  std::int64_t age_ns() const { return age_ns_; }
  bool in_one_thread() const { return one_thread_; }

 private:
  std::atomic<bool> hangs_{false}, one_thread_{true};
  std::atomic<int> updates_{0}, still_{0};
  std::atomic<double> tip_x_mm_{0};
  std::atomic<std::int64_t> taken_ns_{0}, age_ns_{0};
  std::optional<std::thread::id> thread_;
};

// runs a driver in a thread of its own
class Running {
 public:
  explicit Running(DeviceDriver& driver) : thread_([this, &driver] { driver.run(servo_, clock_); }) {}
  ~Running() { stop(); }
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;
  void stop() {
    clock_.stop();
    if (thread_.joinable()) thread_.join();
  }
  Wall& servo() { return servo_; }

 private:
  TestClock clock_;
  Wall servo_;
  std::thread thread_;
};

// waits until the next `count` updates are complete
bool pass_updates(const Wall& servo, int count) {
  const int before = servo.updates();
  return soon([&] { return servo.updates() >= before + count; });
}

// rest position of a tip that the hand aims at `intended_mm`, with and without the wall
double pressed_mm(double intended_mm) {
  return intended_mm * kHand_N_per_mm / (kHand_N_per_mm + kWall_N_per_mm);
}
bool settles_at(const Wall& servo, double x_mm) {
  return soon([&] { return servo.still() > 10 && std::abs(servo.tip_x_mm() - x_mm) < 2e-3; });
}

// a driver with its counterpart; the hand aims at 3 mm behind the wall's surface
struct Rig {
  static constexpr double kIntended_mm = 3;

  explicit Rig(const std::string& kind) {
    SimulatedDevice device(kLight, kStill);
    device.reset(Point<Device>(kIntended_mm, 0, 0));
    if (kind == "pulled") {
      driver = std::make_unique<SimulatedDriver>(device);
    } else if (kind == "callback") {
      vendor = std::make_unique<FakeVendor>(device);
      driver = std::make_unique<CallbackDriver>(*vendor);
    } else {
      peer = std::make_unique<FakePeer>(device);
      driver = std::make_unique<ExchangeDriver>(*peer);
    }
    EXPECT_TRUE(driver->open(false).ok());
  }
  // commands that the device received, for kinds that record them
  std::vector<Delivery> delivered() const {
    return vendor ? vendor->delivered() : peer ? peer->delivered() : std::vector<Delivery>{};
  }

  int violations() const { return vendor ? vendor->violations() : 0; }

  std::unique_ptr<FakeVendor> vendor;
  std::unique_ptr<FakePeer> peer;
  std::unique_ptr<DeviceDriver> driver;
};

class EveryDriver : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Port, EveryDriver, ::testing::Values("pulled", "callback", "exchange"),
                         [](const auto& tested) { return std::string(tested.param); });

TEST_P(EveryDriver, ReportsItsDevice) {
  const Rig rig(GetParam());
  ASSERT_EQ(rig.driver->devices().size(), 1u);
  const DeviceInfo& info = rig.driver->devices()[0];
  EXPECT_EQ(info.name, "light (simulated)");
  EXPECT_TRUE(info.simulated);
  const auto expected = rig.vendor ? DeviceInfo::Drive::kCallback
                        : rig.peer ? DeviceInfo::Drive::kExchange
                                   : DeviceInfo::Drive::kPulled;
  EXPECT_EQ(info.drive, expected);
}

TEST_P(EveryDriver, RendersTheSameForceForTheSameServo) {
  // equilibrium of the hand's spring and the wall: the same position, whichever side owns the clock
  Rig rig(GetParam());
  Running running(*rig.driver);
  EXPECT_TRUE(settles_at(running.servo(), pressed_mm(Rig::kIntended_mm))) << running.servo().tip_x_mm();
  running.stop();
  EXPECT_TRUE(running.servo().in_one_thread());
  EXPECT_EQ(rig.violations(), 0);
}

TEST_P(EveryDriver, HaltSendsZerosUntilResume) {
  Rig rig(GetParam());
  Running running(*rig.driver);
  const Wall& servo = running.servo();
  ASSERT_TRUE(settles_at(servo, pressed_mm(Rig::kIntended_mm)));

  // without force the tip moves to the hand's target, while the servo continues to be called
  rig.driver->halt();
  const std::int64_t halted_ns = monotonic_ns();
  EXPECT_TRUE(settles_at(servo, Rig::kIntended_mm)) << servo.tip_x_mm();
  const std::int64_t resumed_ns = monotonic_ns();
  rig.driver->resume(0);
  EXPECT_TRUE(settles_at(servo, pressed_mm(Rig::kIntended_mm))) << servo.tip_x_mm();
  running.stop();

  // only a request already in flight when halt() returned may still arrive
  int supplied = 0, halted = 0;
  for (const Delivery& delivery : rig.delivered()) {
    if (delivery.at_ns <= halted_ns || delivery.at_ns >= resumed_ns) continue;
    ++halted;
    supplied += delivery.command.force_N.norm() > 0;
  }
  EXPECT_LE(supplied, rig.peer ? 1 : 0);
  // minimum number of samples for which the tip has rested
  EXPECT_TRUE(halted > 5 || (!rig.vendor && !rig.peer)) << halted;
}

TEST_P(EveryDriver, HaltStopsADeviceWhoseServoHangs) {
  Rig rig(GetParam());
  Running running(*rig.driver);
  Wall& servo = running.servo();
  ASSERT_TRUE(settles_at(servo, pressed_mm(Rig::kIntended_mm)));

  // in the first sample after the hang the tip is where the hand alone has moved it
  servo.hang(true);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  rig.driver->halt();
  // a peer goes idle by itself, once its thread is scheduled
  ASSERT_TRUE(!rig.peer || soon([&] { return rig.delivered().back().idle; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(80));
  const std::int64_t ended_ns = monotonic_ns();
  servo.hang(false);
  ASSERT_TRUE(soon([&] { return servo.taken_ns() > ended_ns; }));
  EXPECT_NEAR(servo.tip_x_mm(), Rig::kIntended_mm, 0.05);
}

TEST_P(EveryDriver, HaltBeforeRunIsEffective) {
  Rig rig(GetParam());
  rig.driver->halt();
  Running running(*rig.driver);
  EXPECT_TRUE(pass_updates(running.servo(), 50));
  EXPECT_NEAR(running.servo().tip_x_mm(), Rig::kIntended_mm, 1e-9) << "no force has ever acted";
  rig.driver->resume(0);
  EXPECT_TRUE(settles_at(running.servo(), pressed_mm(Rig::kIntended_mm)));
}

TEST_P(EveryDriver, StopSendsZerosAndCanRunAgain) {
  Rig rig(GetParam());
  {
    Running running(*rig.driver);
    EXPECT_TRUE(settles_at(running.servo(), pressed_mm(Rig::kIntended_mm)));
  }
  if (rig.vendor) {
    EXPECT_FALSE(rig.vendor->scheduled());
    EXPECT_EQ(rig.delivered().back().command.force_N, Vector<Device>());
  }
  if (rig.peer) {
    // waits for a request instead of the idling entry; the peer receives it shortly after it was sent
    EXPECT_TRUE(soon([&] {
      auto requests = rig.delivered();
      std::erase_if(requests, [](const Delivery& delivery) { return delivery.idle; });
      return requests.back().command.force_N.norm() == 0;
    }));
  }
  EXPECT_EQ(rig.violations(), 0);

  Running again(*rig.driver);
  EXPECT_TRUE(settles_at(again.servo(), pressed_mm(Rig::kIntended_mm)));
}

TEST_P(EveryDriver, SamplesAreNotFromTheFuture) {
  Rig rig(GetParam());
  Running running(*rig.driver);
  std::int64_t last_ns = 0;
  for (int n = 0; n < 20; ++n) {
    ASSERT_TRUE(pass_updates(running.servo(), 1));
    EXPECT_GE(running.servo().age_ns(), 0);
    EXPECT_GE(running.servo().taken_ns(), last_ns);
    last_ns = running.servo().taken_ns();
  }
}

TEST(CallbackDriver, CommandIsSetInTheFrameOfItsSample) {
  Rig rig("callback");
  Running running(*rig.driver);
  ASSERT_TRUE(settles_at(running.servo(), pressed_mm(Rig::kIntended_mm)));
  const int updates = running.servo().updates();
  running.stop();
  // bit for bit, also while settling: a command of an earlier frame would differ
  const std::vector<Delivery> frames = rig.delivered();
  ASSERT_GT(static_cast<int>(frames.size()), updates);
  int moving = 0;
  for (std::size_t n = 0; n + 1 < frames.size(); ++n) {
    EXPECT_EQ(frames[n].command.force_N, wall(frames[n].sample).force_N) << n;
    moving += frames[n].command.force_N.x() != frames[n + 1].command.force_N.x();
  }
  EXPECT_GT(moving, 3);
}

TEST(CallbackDriver, FakeVendorDetectsForbiddenCalls) {
  // otherwise the counts of violations above could be zero because nothing is detected
  SimulatedDevice device(kLight, kStill);
  const auto violations = [&](const std::function<void(FakeVendor&)>& frame) {
    FakeVendor vendor(device);
    vendor.schedule([&] {
      frame(vendor);
      return false;
    });
    EXPECT_TRUE(soon([&] { return !vendor.scheduled(); }));
    return vendor.violations();
  };
  EXPECT_EQ(violations([](FakeVendor& v) {
              v.begin_frame();
              v.set_force(wall(v.state()));
              v.end_frame();
            }),
            0);
  EXPECT_EQ(violations([](FakeVendor& v) { (void)v.state(); }), 1);
  EXPECT_EQ(violations([](FakeVendor& v) { v.set_force({}); }), 1);
  EXPECT_EQ(violations([](FakeVendor& v) { v.end_frame(); }), 1);
  EXPECT_EQ(violations([](FakeVendor& v) { v.begin_frame(); }), 1) << "never ended";
  EXPECT_EQ(violations([](FakeVendor& v) {
              v.begin_frame();
              v.begin_frame();
              v.end_frame();
            }),
            1);
  EXPECT_EQ(violations([](FakeVendor& v) {
              v.begin_frame();
              std::thread([&] { v.set_force({}); }).join();
              v.end_frame();
            }),
            1)
      << "another thread";
}

TEST(ExchangeDriver, RequestAnswersThePreviousReply) {
  Rig rig("exchange");
  Running running(*rig.driver);
  ASSERT_TRUE(settles_at(running.servo(), pressed_mm(Rig::kIntended_mm)));
  running.stop();
  const std::vector<Delivery> requests = rig.delivered();
  // while settling, when the previous reply asked for another force; a busy machine omits some
  int answered = 0;
  for (std::size_t n = 2; n < requests.size(); ++n) {
    const auto requested_N = [&](std::size_t reply) { return wall(requests[reply].sample).force_N; };
    answered += requested_N(n - 1) != requested_N(n - 2) && requests[n].command.force_N == requested_N(n - 1);
  }
  EXPECT_GT(answered, 3);
}

TEST(ExchangeDriver, SilentPeerIncreasesThePoseAge) {
  Rig rig("exchange");
  Running running(*rig.driver);
  const Wall& servo = running.servo();
  ASSERT_TRUE(settles_at(servo, pressed_mm(Rig::kIntended_mm)));

  // the servo is still called, with the last state
  rig.peer->silence(true);
  EXPECT_TRUE(soon([&] { return servo.age_ns() > 50'000'000; }));
  const std::int64_t taken_ns = servo.taken_ns();
  EXPECT_TRUE(pass_updates(servo, 5));
  EXPECT_EQ(servo.taken_ns(), taken_ns);

  // it recovers
  rig.peer->silence(false);
  EXPECT_TRUE(soon([&] { return servo.taken_ns() > taken_ns && servo.age_ns() < 50'000'000; }));
  EXPECT_TRUE(settles_at(servo, pressed_mm(Rig::kIntended_mm)));
}

TEST(Consent, SelfMovingArmRequiresConsent) {
  FakeVendor vendor(SimulatedDevice(kLight, kStill));
  CallbackDriver driver(vendor, true);
  const auto refused = driver.open(false);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kUsage);
  EXPECT_EQ(refused.error().where, "light (simulated)");
  EXPECT_NE(refused.error().what.find("moves by itself"), std::string::npos);
  EXPECT_NE(refused.error().remedy.find("allow"), std::string::npos);
  EXPECT_TRUE(driver.open(true).ok());
}

}  // namespace
}  // namespace palpate
