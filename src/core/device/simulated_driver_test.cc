#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <thread>

#include "device/test_drivers.h"
#include "palpate/device/simulated_device.h"

namespace palpate {
namespace {

using testing::virtual_ns;
using testing::virtual_time;

// stiff enough for the tip to follow the intended position
const PlantDevice kFrictionless{"ideal", 0.05, 0, 0, 0, 1e9, 1e9};
const PlantHand kIron{"iron", 0.05, 100, 50000};
const PlantHand kNone{"none", 0.05, 0, 0};

constexpr std::int64_t kMillisecond_ns = 1'000'000;

// passes every sample to a callback on the servo's thread
class Servo final : public ServoFunction {
 public:
  explicit Servo(std::function<DeviceCommand(const DeviceSample&)> answer) : answer_(std::move(answer)) {}
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    samples_.push_back(samples[0]);
    commands[0] = answer_(samples[0]);
  }
  const std::vector<DeviceSample>& samples() const { return samples_; }

 private:
  std::function<DeviceCommand(const DeviceSample&)> answer_;
  std::vector<DeviceSample> samples_;
};

// a number of ticks at 1 ms, with stalls in between on request
class Ticks final : public ServoClock {
 public:
  explicit Ticks(int count, int stall_at = -1, std::int64_t stall_ns = 0)
      : left_(count), stall_at_(stall_at), stall_ns_(stall_ns) {}
  bool wait() noexcept override {
    if (stopped()) return false;
    virtual_ns += left_ == stall_at_ ? stall_ns_ : kMillisecond_ns;
    --left_;
    return true;
  }
  bool stopped() const noexcept override { return left_ == 0; }

 private:
  int left_;
  const int stall_at_;
  const std::int64_t stall_ns_;
};

// continues until the samples are past a point in time
class Until final : public ServoClock {
 public:
  explicit Until(std::int64_t end_ns) : end_ns_(end_ns) {}
  void set_end(std::int64_t end_ns) { end_ns_ = end_ns; }
  bool wait() noexcept override {
    virtual_ns += kMillisecond_ns / 2;
    return !stopped();
  }
  bool stopped() const noexcept override { return virtual_ns > end_ns_; }

 private:
  std::int64_t end_ns_;
};

SimulatedDevice device_at(const PlantHand& hand, const Point<Device>& tip) {
  SimulatedDevice device(kFrictionless, hand);
  device.reset(tip);
  return device;
}

TEST(SimulatedDriver, MovesTheHandAtConstantSpeedToTheTarget) {
  SimulatedDriver driver(device_at(kIron, Point<Device>(1, 2, 3)), virtual_time);
  const Point<Device> target(11, -8, 8);
  const std::int64_t begin_ns = virtual_ns, at_ns = begin_ns + 80 * kMillisecond_ns;
  driver.intend(target, at_ns);
  Servo servo([](const DeviceSample&) { return DeviceCommand{}; });
  Until clock(at_ns + 20 * kMillisecond_ns);
  driver.run(servo, clock);

  // on the line and in time with it; the initial step in velocity decays within a few milliseconds
  int on_the_way = 0;
  for (const DeviceSample& sample : servo.samples()) {
    if (sample.taken_ns < begin_ns + 20 * kMillisecond_ns) continue;
    const double part = std::min(
        1.0, static_cast<double>(sample.taken_ns - begin_ns) / static_cast<double>(at_ns - begin_ns));
    const Point<Device> expected = Point<Device>(1, 2, 3) + (target - Point<Device>(1, 2, 3)) * part;
    EXPECT_LT((sample.tip - expected).norm(), 0.5) << part;
    on_the_way += part < 1;
  }
  EXPECT_GT(on_the_way, 0);
  EXPECT_LT((driver.true_tip() - target).norm(), 0.02);
}

TEST(SimulatedDriver, NewIntentionStartsAtTheCurrentPosition) {
  // reversed halfway: never beyond the half, and no jump
  SimulatedDriver driver(device_at(kIron, Point<Device>()), virtual_time);
  driver.intend(Point<Device>(20, 0, 0), virtual_ns + 120 * kMillisecond_ns);
  double turned_at_mm = -1;
  Until clock(std::numeric_limits<std::int64_t>::max());
  Servo servo([&](const DeviceSample& sample) {
    if (turned_at_mm < 0 && sample.tip.x() > 10) {
      turned_at_mm = sample.tip.x();
      driver.intend(Point<Device>(0, 0, 0), sample.taken_ns + 60 * kMillisecond_ns);
      clock.set_end(sample.taken_ns + 80 * kMillisecond_ns);
    }
    return DeviceCommand{};
  });
  driver.run(servo, clock);
  ASSERT_GT(turned_at_mm, 0);
  double farthest_mm = 0, fastest_mm_s = 0;
  for (std::size_t n = 1; n < servo.samples().size(); ++n) {
    const DeviceSample &a = servo.samples()[n - 1], &b = servo.samples()[n];
    farthest_mm = std::max(farthest_mm, b.tip.x());
    const double dt_s = static_cast<double>(b.taken_ns - a.taken_ns) * 1e-9;
    fastest_mm_s = std::max(fastest_mm_s, (b.tip - a.tip).norm() / dt_s);
  }
  EXPECT_LT(farthest_mm, turned_at_mm + 1);
  EXPECT_LT(fastest_mm_s, 1.5 * turned_at_mm / 0.06 + 50) << "a jump";
  EXPECT_LT(driver.true_tip().x(), 0.1);
}

TEST(SimulatedDriver, PastIntentionAppliesImmediately) {
  SimulatedDriver driver(device_at(kIron, Point<Device>()), virtual_time);
  driver.intend(Point<Device>(0, 0, 2), 0);
  Servo servo([](const DeviceSample&) { return DeviceCommand{}; });
  Ticks clock(20);
  driver.run(servo, clock);
  EXPECT_NEAR(driver.true_tip().z(), 2, 0.01);
}

TEST(SimulatedDriver, PlantAdvancesByElapsedTime) {
  // a free mass under a constant force: its speed measures the elapsed time. 130 ms of stall count as 100
  SimulatedDriver driver(device_at(kNone, Point<Device>()), virtual_time);
  Servo servo([](const DeviceSample&) { return DeviceCommand{Vector<Device>(0, 0.02, 0), {}}; });
  Ticks clock(30, 10, 130 * kMillisecond_ns);
  driver.run(servo, clock);
  // the first command acts from the first tick on
  double contact_s = 0, stalled_s = 0;
  for (std::size_t n = 1; n < servo.samples().size(); ++n) {
    const double dt_s =
        static_cast<double>(servo.samples()[n].taken_ns - servo.samples()[n - 1].taken_ns) * 1e-9;
    contact_s += std::min(dt_s, SimulatedDriver::kMaxAdvance_s);
    stalled_s += std::max(0.0, dt_s - SimulatedDriver::kMaxAdvance_s);
  }
  EXPECT_GT(stalled_s, 0.025);
  const double speed_mm_s = driver.device().true_velocity_mm_s().y();
  EXPECT_NEAR(speed_mm_s, 0.02 / 0.1 * contact_s * 1e3, 1e-6);
}

TEST(SimulatedDriver, CommandEndsWithItsRun) {
  // a free mass that was pushed keeps its speed, bit for bit, when it is run again without a force
  SimulatedDriver driver(device_at(kNone, Point<Device>()), virtual_time);
  Servo pushes([](const DeviceSample&) { return DeviceCommand{Vector<Device>(0.3, -0.2, 0.1), {}}; });
  Ticks first(20), second(20);
  driver.run(pushes, first);
  const Vector<Device> speed = driver.device().true_velocity_mm_s();
  EXPECT_GT(speed.norm(), 1);
  Servo rests([](const DeviceSample&) { return DeviceCommand{}; });
  driver.run(rests, second);
  EXPECT_EQ(driver.device().true_velocity_mm_s(), speed);
}

TEST(SimulatedDriver, IntentionsAreConsistentAcrossThreads) {
  SimulatedDriver driver(device_at(kIron, Point<Device>()), virtual_time);
  std::atomic<int> declared{0};
  std::atomic<bool> ended{false};
  std::thread hand([&] {
    for (; !ended; ++declared) {
      // a torn read would leave the diagonal
      const double x = 5 * std::sin(0.01 * declared);
      driver.intend(Point<Device>(x, x, x), virtual_ns + kMillisecond_ns);
      std::this_thread::yield();
    }
  });
  // until both threads have alternated several hundred times
  int ticks = 0;
  Servo servo([&](const DeviceSample&) {
    for (++ticks; declared < ticks;) std::this_thread::yield();
    return DeviceCommand{};
  });
  Ticks clock(500);
  driver.run(servo, clock);
  ended = true;
  hand.join();
  for (const DeviceSample& sample : servo.samples()) {
    EXPECT_NEAR(sample.tip.x(), sample.tip.y(), 1e-9);
    EXPECT_NEAR(sample.tip.x(), sample.tip.z(), 1e-9);
    EXPECT_LT(std::abs(sample.tip.x()), 12);
  }
}

TEST(SimulatedDriver, PlantAccessWhileRunningAborts) {
  SimulatedDriver driver(device_at(kIron, Point<Device>()), virtual_time);
  Servo servo([&](const DeviceSample&) {
    (void)driver.true_tip();
    return DeviceCommand{};
  });
  Ticks clock(1);
  EXPECT_DEATH(driver.run(servo, clock), "running_");
  EXPECT_DEATH(driver.intend(Point<Device>(0, std::nan(""), 0), 0), "finite");
}

TEST(SimulatedDriver, ReportsTheDeviceSpecifications) {
  const SimulatedDriver driver(SimulatedDevice(*find_plant_device("touch"), *find_plant_hand("light-grip")));
  const DeviceInfo& info = driver.devices()[0];
  EXPECT_EQ(info.drive, DeviceInfo::Drive::kPulled);
  EXPECT_EQ(info.peak_force_N, 3.3);
  EXPECT_EQ(info.continuous_force_N, 0.88);
  EXPECT_NEAR(*info.position_step_mm, 0.055, 1e-12);
  // its corners lie on the ball of the device's reach
  ASSERT_TRUE(info.workspace.has_value());
  EXPECT_NEAR((info.workspace->high - Point<Device>()).norm(), 75, 1e-9);
  EXPECT_NEAR((info.workspace->low - Point<Device>()).norm(), 75, 1e-9);
  // unknown properties are empty
  EXPECT_FALSE(info.stiffness_N_per_mm.has_value());
  EXPECT_FALSE(info.peak_torque_Nmm.has_value());
  EXPECT_FALSE(info.rate_hz.has_value());
  EXPECT_FALSE(SimulatedDevice(kFrictionless, kIron).info().workspace.has_value());
}

}  // namespace
}  // namespace palpate
