#include "palpate/servo/composite_driver.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <mutex>
#include <thread>

#include "base/test_wait.h"
#include "contact/test_model.h"
#include "palpate/base/clock.h"
#include "palpate/base/spsc_ring.h"
#include "palpate/device/bounds.h"
#include "palpate/device/device_parameters.h"
#include "palpate/device/pointer_driver.h"
#include "palpate/device/simulated_device.h"

namespace palpate {
namespace {

using testing::kBoneRadius_mm;
using testing::soon;

std::shared_ptr<const Model> followed_ball() {
  return std::make_shared<const Model>(testing::ball_model({1, 1, 1}));
}

// a hand that holds the tip at `x_mm` from the ball's centre
SimulatedDriver limiting_devices(const char* plant, double x_mm) {
  SimulatedDevice device(*find_plant_device(plant), *find_plant_hand("firm-grip"));
  device.reset(Point<Device>(x_mm, 0, 0));
  return SimulatedDriver(device);
}

// a driver with its own clock: updates every `period` and records the commands
class OwnClock final : public DeviceDriver {
 public:
  explicit OwnClock(std::chrono::microseconds period, double x_mm = kBoneRadius_mm - 1)
      : period_(period), x_mm_(x_mm) {
    info.name = "own clock";
    info.drive = DeviceInfo::Drive::kCallback;
    info.rate_hz = 1e6 / static_cast<double>(period.count());
    info.peak_force_N = 3;
  }
  std::span<const DeviceInfo> devices() const override { return {&info, 1}; }
  Result<void> open(bool may_move) override { return require_consent(info, may_move); }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override {
    std::thread([&] {
      while (!clock.stopped() && !gives_up) {
        std::this_thread::sleep_for(period_);
        if (hangs) continue;
        DeviceSample sample;
        sample.tip = Point<Device>(x_mm_, 0, 0);
        sample.taken_ns = monotonic_ns();
        DeviceCommand command;
        servo.update({&sample, 1}, {&command, 1});
        force_N = halted ? 0 : command.force_N.norm();
        ++updates;
      }
    }).join();
    force_N = 0;
  }
  void halt() noexcept override { halted = true; }
  void resume(std::uint64_t /*newest*/) noexcept override { halted = false; }

  DeviceInfo info;
  std::atomic<bool> hangs{false}, gives_up{false}, halted{false};
  std::atomic<double> force_N{0};
  std::atomic<int> updates{0};

 private:
  const std::chrono::microseconds period_;
  const double x_mm_;
};

std::unique_ptr<ServoLoop> loop_of(DeviceDriver& driver, double rate_hz = 1000) {
  auto loop = ServoLoop::start(followed_ball(), driver, {}, {WorkspaceSettings{}},
                               {.rate_hz = rate_hz, .realtime = false, .ring_s = 10});
  EXPECT_TRUE(loop.ok()) << (loop.ok() ? "" : loop.error().message());
  return std::move(*loop);
}

TEST(CompositeDriver, EachDeviceRendersAtItsOwnPositionAndRate) {
  SimulatedDriver first = limiting_devices("premium-1.5", kBoneRadius_mm - 2);
  SimulatedDriver second = limiting_devices("touch", -(kBoneRadius_mm - 2));
  CompositeDriver both({&first, &second}, {.rate_hz = 250, .realtime = false});
  const auto loop = loop_of(both);
  ASSERT_EQ(loop->devices().size(), 2u);
  EXPECT_TRUE(soon([&] {
    const TickRecord tick = loop->snapshot();
    return tick.devices == 2 && tick.device[0].force_N[0] > 0.2 && tick.device[1].force_N[0] < -0.2;
  }));
  const TickRecord record = loop->snapshot();
  EXPECT_EQ(record.device[0].peak_force_N, 8.5);
  EXPECT_EQ(record.device[1].peak_force_N, 3.3);
  // each hand is pushed back by its own ball only
  EXPECT_NEAR(record.device[0].tip_world_mm[1], 0, 0.5);
  EXPECT_GT(record.device[0].tip_world_mm[0], 0);
  EXPECT_LT(record.device[1].tip_world_mm[0], 0);
  EXPECT_TRUE(soon([&] { return both.followers()[0].updates > 200; }));
  const double ticks = static_cast<double>(loop->health().ticks + loop->health().skipped);
  const double updates = static_cast<double>(both.followers()[0].updates);
  EXPECT_NEAR(ticks / updates, 4, 2) << "both are counted by the same clock";
  loop->stop();
}

TEST(CompositeDriver, FastestForceDeviceOwnsTheClock) {
  const auto owner = [](std::vector<DeviceDriver*> drivers) {
    return CompositeDriver(std::move(drivers), {}).clock_owner();
  };
  PointerDriver pointer{Point<Device>()};
  SimulatedDriver simulated = limiting_devices("touch", 30);
  OwnClock slow(std::chrono::microseconds(4000)), fast(std::chrono::microseconds(1000));
  EXPECT_EQ(owner({&pointer, &simulated}), 1u);
  EXPECT_EQ(owner({&simulated, &pointer}), 0u);
  EXPECT_EQ(owner({&simulated, &slow}), 1u);
  EXPECT_EQ(owner({&slow, &fast, &pointer}), 1u);
  EXPECT_EQ(owner({&fast, &slow}), 0u);
  EXPECT_EQ(owner({&slow}), 0u);
}

TEST(CompositeDriver, FollowerHasReducedStiffnessWithAReason) {
  OwnClock slow(std::chrono::microseconds(4000)), fast(std::chrono::microseconds(1000));
  slow.info.stiffness_N_per_mm = fast.info.stiffness_N_per_mm = 2;
  slow.info.delay_s = fast.info.delay_s = 1e-3;
  const CompositeDriver both({&fast, &slow}, {});
  // the owner has its vendor's stiffness; the follower is delayed by a period of each
  EXPECT_EQ(both.devices()[0].stiffness_N_per_mm, 2);
  EXPECT_EQ(both.devices()[0].delay_s, 1e-3);
  const DeviceInfo& follows = both.devices()[1];
  EXPECT_NEAR(*follows.delay_s, 1e-3 + 4e-3 + 1e-3, 1e-12);
  EXPECT_EQ(*follows.stiffness_N_per_mm, conservative_bounds(follows).stiffness_N_per_mm);
  EXPECT_NEAR(*follows.stiffness_N_per_mm, 0.6 * 2 / (2e-3 + 6e-3) * 1e-3, 1e-9);
  // a lower stiffness is unchanged, and an invalid one stays invalid
  for (const double smallest : {0.01, 0.0, -1.0}) {
    slow.info.stiffness_N_per_mm = smallest;
    EXPECT_EQ(stiffness_bound_N_per_mm(CompositeDriver({&fast, &slow}, {}).devices()[1]),
              std::max(0.0, smallest));
  }
}

TEST(CompositeDriver, UnstatedStiffnessUsesTheConservativeBound) {
  OwnClock follows(std::chrono::microseconds(2000)), owns(std::chrono::microseconds(1000));
  CompositeDriver both({&follows, &owns}, {.realtime = false});
  const auto loop = loop_of(both);
  for (std::size_t d = 0; d < 2; ++d) {
    EXPECT_EQ(loop->parameters().device[d].max_stiffness_N_per_mm,
              conservative_bounds(both.devices()[d]).stiffness_N_per_mm);
    EXPECT_LT(loop->parameters().device[d].max_stiffness_N_per_mm, 0.3);
  }
  EXPECT_TRUE(soon([&] { return loop->snapshot().tick > 1000; }));
  loop->stop();
  std::vector<TickRecord> records(4096);
  records.resize(loop->ring().pop(records));
  ASSERT_FALSE(records.empty());
  double max_N = 0;
  for (const TickRecord& record : records)
    for (std::size_t d = 0; d < 2; ++d) {
      const DeviceTick& device = record.device[d];
      ASSERT_EQ(device.max_stiffness_N_per_mm, loop->parameters().device[d].max_stiffness_N_per_mm);
      max_N = std::max(max_N, std::abs(device.force_N[0]));
    }
  // the ball's field yields at most 4 N per 2 mm times its fraction: at a millimetre's depth, the bound
  EXPECT_GT(max_N, 0);
  EXPECT_LT(max_N, 1.5);
}

TEST(CompositeDriver, HangingFollowerLosesForceAndOthersDoNot) {
  SimulatedDriver owns = limiting_devices("premium-1.5", kBoneRadius_mm - 2);
  OwnClock follows(std::chrono::microseconds(4000));
  follows.info.simulated = true;
  // both simulated; the slower one follows
  CompositeDriver both({&owns, &follows}, {.realtime = false});
  ASSERT_EQ(both.clock_owner(), 0u);
  const auto loop = loop_of(both);
  ASSERT_TRUE(soon([&] { return follows.force_N > 0.3 && loop->snapshot().device[0].force_N[0] > 0.2; }));
  follows.hangs = true;
  EXPECT_TRUE(soon([&] { return (loop->snapshot().device[1].flags & kFlagStale) != 0; }));
  EXPECT_TRUE(soon([&] { return loop->snapshot().device[1].force_N[0] == 0; }));
  const std::uint64_t then = loop->snapshot().tick;
  EXPECT_TRUE(soon([&] { return loop->snapshot().tick > then + 50; }));
  EXPECT_TRUE(soon([&] { return loop->snapshot().device[0].force_N[0] > 0.2; }));
  // the force returns
  follows.hangs = false;
  EXPECT_TRUE(soon([&] { return follows.force_N > 0.3; }));
  loop->stop();
  EXPECT_EQ(follows.force_N, 0);
}

// ticks at its own rate until it is made to hang; its tip is pressed in
class Hanging final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    while (hangs) std::this_thread::yield();
    for (std::size_t d = 0; d < samples.size(); ++d) commands[d].force_N = Vector<Device>(1, 0, 0);
    ++ticks;
  }
  std::atomic<bool> hangs{false};
  std::atomic<int> ticks{0};
};
class StoppedByHand final : public ServoClock {
 public:
  bool wait() noexcept override {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return !stop;
  }
  bool stopped() const noexcept override { return stop; }
  std::atomic<bool> stop{false};
};

TEST(CompositeDriver, OldCommandIsIgnored) {
  SimulatedDriver owns = limiting_devices("premium-1.5", kBoneRadius_mm);
  OwnClock follows(std::chrono::microseconds(2000));
  follows.info.simulated = true;
  CompositeDriver both({&owns, &follows}, {.realtime = false});
  ASSERT_EQ(both.clock_owner(), 0u);
  Hanging servo;
  StoppedByHand clock;
  std::thread running([&] { both.run(servo, clock); });
  EXPECT_TRUE(soon([&] { return follows.force_N == 1; }));
  servo.hangs = true;
  EXPECT_TRUE(soon([&] { return follows.force_N == 0; })) << "with nobody to halt it";
  servo.hangs = false;
  EXPECT_TRUE(soon([&] { return follows.force_N == 1; }));
  // a halt reaches all drivers
  both.halt();
  EXPECT_TRUE(follows.halted);
  EXPECT_TRUE(soon([&] { return follows.force_N == 0; }));
  both.resume(0);
  EXPECT_FALSE(follows.halted);
  clock.stop = true;
  running.join();
  EXPECT_EQ(follows.force_N, 0);
}

TEST(CompositeDriver, FollowerDriverFailureIsReportedAndOthersContinue) {
  SimulatedDriver owns = limiting_devices("premium-1.5", kBoneRadius_mm - 2);
  OwnClock follows(std::chrono::microseconds(2000));
  follows.info.simulated = true;
  CompositeDriver both({&owns, &follows}, {.realtime = false});
  const auto loop = loop_of(both);
  ASSERT_TRUE(soon([&] { return follows.force_N > 0.3; }));
  EXPECT_FALSE(both.failure());
  follows.gives_up = true;
  EXPECT_TRUE(soon([&] { return (loop->snapshot().device[1].flags & kFlagDeviceFault) != 0; }));
  EXPECT_TRUE(soon([&] { return both.failure().has_value(); }));
  EXPECT_EQ(both.failure()->where, "own clock");
  EXPECT_FALSE(both.failure()->remedy.empty());
  EXPECT_TRUE(loop->running());
  EXPECT_TRUE(soon([&] { return loop->snapshot().device[0].force_N[0] > 0.2; }));
  EXPECT_EQ(loop->snapshot().device[1].force_N[0], 0);
  loop->stop();
}

TEST(CompositeDriver, MonitorsTheThreadsThatExchangeWithDevices) {
  SimulatedDriver owns = limiting_devices("premium-1.5", kBoneRadius_mm);
  OwnClock follows(std::chrono::microseconds(2000));
  follows.info.simulated = true;
  CompositeDriver both({&owns, &follows}, {.realtime = false});
  const auto loop = loop_of(both);
  ASSERT_TRUE(soon([&] { return both.followers()[0].updates > 20; }));
  EXPECT_EQ(loop->ticking().device, "premium-1.5 (simulated)");
  EXPECT_GT(loop->ticking().updates, 0u);
  EXPECT_EQ(both.followers()[0].device, "own clock");
  EXPECT_EQ(both.followers()[0].scheduler, "SCHED_OTHER") << "of the thread that calls back";
  // missing updates are late, and are counted for that thread
  const std::uint64_t late = both.followers()[0].late.total();
  EXPECT_TRUE(soon([&] {
    follows.hangs = true;
    std::this_thread::sleep_for(std::chrono::milliseconds(8));
    follows.hangs = false;
    std::this_thread::sleep_for(std::chrono::milliseconds(8));
    return both.followers()[0].late.total() > late + 3;
  }));
  loop->stop();

  // if the owner calls back, the vendor's thread ticks
  OwnClock alone(std::chrono::microseconds(2000));
  const auto called = loop_of(alone);
  EXPECT_TRUE(soon([&] { return called->ticking().scheduler == "SCHED_OTHER"; }))
      << called->ticking().scheduler;
  called->stop();
}

TEST(CompositeDriver, CanRunRepeatedly) {
  SimulatedDriver owns = limiting_devices("premium-1.5", kBoneRadius_mm - 2);
  OwnClock follows(std::chrono::microseconds(2000));
  follows.info.simulated = true;
  CompositeDriver both({&owns, &follows}, {.realtime = false});
  for (int round = 0; round < 2; ++round) {
    const auto loop = loop_of(both);
    EXPECT_TRUE(soon([&] { return follows.force_N > 0.3; })) << round;
    loop->stop();
    EXPECT_EQ(follows.force_N, 0);
  }
}

}  // namespace
}  // namespace palpate
