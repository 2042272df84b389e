#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>

#include "loading/test_loading.h"
#include "palpate/base/clock.h"
#include "palpate/device/bounds.h"
#include "palpate/device/simulated_device.h"
#include "palpate/session/explore.h"

/// Sessions with named devices, and with several devices.
namespace palpate {
namespace {

using ::testing::HasSubstr;

// vendor's device with a clock of its own, held by a stiff simulated hand that presses it into the ball
class HeldArm final : public DeviceDriver {
 public:
  struct Reported {
    std::atomic<bool> lost{false};
    std::atomic<double> largest_N{0};
    std::atomic<int> updates{0};
  };
  HeldArm(Reported& reported, double rate_hz, bool simulated, const Point<Device>& at)
      : reported_(reported),
        period_(1 / rate_hz),
        plant_(*find_plant_device("touch"), *find_plant_hand("firm-grip")) {
    plant_.reset(at);
    info_ = plant_.info();
    info_.name = "held arm";
    info_.simulated = simulated;
    info_.drive = DeviceInfo::Drive::kCallback;
    info_.rate_hz = rate_hz;
    info_.workspace.reset();
  }
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool may_move) override { return require_consent(info_, may_move); }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override {
    DeviceCommand command;
    // approaches from outside at 10 mm/s once the force has ramped in: contact that begins inside is ignored
    const Point<Device> pressed = plant_.intention();
    double outside_mm = 4;
    plant_.reset(pressed + Vector<Device>(outside_mm, 0, 0));
    while (!clock.stopped()) {
      std::this_thread::sleep_for(period_);
      outside_mm = std::max(0.0, outside_mm - 10 * period_.count());
      plant_.intend(pressed + Vector<Device>(outside_mm, 0, 0));
      plant_.advance(command, period_.count());
      DeviceSample sample = plant_.read();
      sample.taken_ns = monotonic_ns();
      sample.fault = reported_.lost;
      servo.update({&sample, 1}, {&command, 1});
      reported_.largest_N = std::max(reported_.largest_N.load(), command.force_N.norm());
      ++reported_.updates;
    }
  }
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}
  std::optional<Error> failure() const override {
    if (!reported_.lost) return std::nullopt;
    return Error{ErrorKind::kUnavailable, "its cable is out", info_.name, "plug it in"};
  }

 private:
  Reported& reported_;
  const std::chrono::duration<double> period_;
  SimulatedDevice plant_;
  DeviceInfo info_;
};

// device that never runs
class FourArms final : public DeviceDriver {
 public:
  std::span<const DeviceInfo> devices() const override { return infos_; }
  Result<void> open(bool /*may_move*/) override { return {}; }
  void run(ServoFunction& /*servo*/, ServoClock& /*clock*/) noexcept override {}
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

 private:
  const std::array<DeviceInfo, 4> infos_;
};

class SeveralDevices : public ::testing::Test {
 protected:
  // session with an arm named "arm", which starts where the ball's surface is on the right
  ExploreOptions with_arm(std::vector<std::string> devices, double rate_hz, bool simulated = false) {
    ExploreOptions options;
    options.devices = std::move(devices);
    options.loop.realtime = false;
    options.loop.ring_s = 30;
    // on a machine with many stalls the hand waits long for its force
    options.seconds = 60;
    options.known.add({"arm", "an arm",
                       [this, rate_hz, simulated] {
                         return std::make_unique<HeldArm>(reported_, rate_hz, simulated,
                                                          Point<Device>(testing::kBoneRadius_mm - 2, 0, 0));
                       },
                       [] { return DeviceReport(); }});
    return options;
  }
  Recording run(const ExploreOptions& options, const Script& script,
                const std::function<void(const ExploreStatus&)>& status = {}) {
    const auto file = folder_ / "run.h5";
    auto result = explore(loaded_, script, options, file, Progress({}, &stop_), status);
    PALPATE_CHECK(result.ok());
    result_ = *std::move(result);
    auto read = read_recording(file);
    PALPATE_CHECK(read.ok());
    const auto again = replay(*read, loaded_.model);
    EXPECT_TRUE(again.ok()) << again.error().message();
    EXPECT_TRUE(again->identical) << again->difference;
    EXPECT_EQ(again->run_hash, result_->summary.run_hash);
    EXPECT_EQ(result_->health.dropped, 0u);
    return *std::move(read);
  }
  static Script touch() {
    return parse_script(
               "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\npress = 0.5\n"
               "[[step]]\nhold = 1.0\n[[step]]\nleave = true\nspeed = 200.0\n",
               "test script")
        .value();
  }

  test::TemporaryFolder folder_;
  LoadedScene loaded_ = testing::loaded_ball();
  HeldArm::Reported reported_;
  std::atomic<bool> stop_{false};
  std::optional<ExploreResult> result_;
};

// 1 kHz and 250 Hz on one ball: whichever device is the follower, the recording contains both and replays
TEST_F(SeveralDevices, OfTwoRatesAreRecordedAndReplayed) {
  const Recording recording = run(with_arm({kSimulatedHand, "arm"}, 250, true), touch());
  EXPECT_EQ(recording.header.devices, 2);
  EXPECT_EQ(recording.header.device, "premium-1.5, arm");
  ASSERT_FALSE(recording.ticks.empty());
  std::size_t both = 0, held = 0, moved = 0;
  for (std::size_t n = 1; n < recording.ticks.size(); ++n) {
    const TickRecord& tick = recording.ticks[n];
    ASSERT_EQ(tick.devices, 2);
    const auto pushed = [&](std::size_t d) {
      const auto& f = tick.device[d].force_N;
      return std::hypot(f[0], f[1], f[2]) > 0.05;
    };
    both += pushed(0) && pushed(1);
    const bool same = tick.device[1].tip_world_mm == recording.ticks[n - 1].device[1].tip_world_mm;
    held += same;
    moved += !same;
  }
  EXPECT_GT(both, 50u) << "felt at once";
  // several ticks use the same state of the slower device
  EXPECT_GT(held, moved);
  ASSERT_EQ(result_->threads.size(), 2u);
  EXPECT_EQ(result_->threads[1].device, "held arm");
  EXPECT_GT(result_->threads[1].updates, 0u);
  EXPECT_EQ(recording.ticks[0].device[1].peak_force_N, 3.3);
  EXPECT_EQ(recording.ticks[0].device[0].peak_force_N, 8.5);
  EXPECT_NEAR(recording.ticks[0].device[1].delay_s, 1.0 / 250 + 1.0 / 1000, 1e-9);
}

TEST_F(SeveralDevices, APhysicalOneOwnsTheClockAndIsNeverStifferThanIsCareful) {
  std::string reported;
  ExploreOptions options = with_arm({kSimulatedHand, "arm"}, 500);
  const Recording recording =
      run(options, touch(), [&](const ExploreStatus& status) { reported = status.conservative_bounds; });
  EXPECT_THAT(reported, HasSubstr("the stable stiffness of held arm is unknown"));
  EXPECT_THAT(result_->problems.front() + result_->problems.back(), HasSubstr("held arm"));
  DeviceInfo info;
  info.rate_hz = 500;
  const ConservativeBounds careful = conservative_bounds(info);
  for (const TickRecord& tick : recording.ticks) {
    ASSERT_EQ(tick.device[1].max_stiffness_N_per_mm, careful.stiffness_N_per_mm);
    ASSERT_EQ(tick.device[1].max_damping_N_s_per_mm, careful.damping_N_s_per_mm);
  }
  EXPECT_GT(reported_.largest_N, 0);
  // two millimetres deep at most, and less because the hand is pushed back
  EXPECT_LT(reported_.largest_N, 3 * careful.stiffness_N_per_mm);
  EXPECT_EQ(result_->threads[0].device, "held arm") << "its thread ticks";
  EXPECT_LE(recording.ticks[0].max_force_N, 0.88) << "its continuous force";
}

TEST_F(SeveralDevices, SinglePhysicalDeviceSetsTheRateAndIsRecordedAsReal) {
  ExploreOptions options = with_arm({"arm"}, 500);
  options.seconds = 1;
  const Recording recording = run(options, Script());
  EXPECT_EQ(recording.header.devices, 1);
  EXPECT_EQ(recording.header.device, "arm");
  EXPECT_FALSE(recording.header.simulated);
  EXPECT_EQ(recording.header.rate_hz, 500) << "its clock's";
  EXPECT_GT(reported_.updates, 0);
  EXPECT_GT(result_->max_force_N, 0);
}

TEST_F(SeveralDevices, DeviceFailureIsReportedAndTheSessionContinues) {
  ExploreOptions options = with_arm({"arm"}, 500);
  options.seconds = 60;
  enum { kWell, kLost, kBack } part = kWell;
  bool reported_gone = false;
  run(options, Script(), [&](const ExploreStatus& status) {
    if (part == kWell && status.force_N > 0) {
      reported_.lost = true;
      part = kLost;
    } else if (part == kLost && status.device_failure && status.force_N == 0) {
      EXPECT_EQ(status.device_failure->message(), "held arm: its cable is out\n  plug it in");
      EXPECT_TRUE(status.flags & kFlagDeviceFault);
      reported_.lost = false;
      part = kBack;
    } else if (part == kBack && !status.device_failure && status.force_N > 0) {
      reported_gone = true;
      stop_.store(true);
    }
  });
  EXPECT_TRUE(reported_gone);
  EXPECT_FALSE(result_->device_lost);
}

TEST_F(SeveralDevices, NamesThatCannotBeAreRefusedWithThoseThatAreThere) {
  const auto refused = [&](std::vector<std::string> devices) {
    const ExploreOptions options = with_arm(std::move(devices), 500);
    const auto result = explore(loaded_, touch(), options, "");
    EXPECT_FALSE(result.ok());
    EXPECT_EQ(result.error().kind, ErrorKind::kUsage);
    return result.error().message();
  };
  EXPECT_THAT(refused({"spoon"}), HasSubstr("there are: simulated, pointer, ros2, arm"));
  EXPECT_THAT(refused({"arm", "arm"}), HasSubstr("twice"));
  EXPECT_THAT(refused({"arm", kSimulatedHand}), HasSubstr("first"));
  EXPECT_THAT(refused({}), HasSubstr("needs a device"));
  // a name may stand for several devices
  ExploreOptions options = with_arm({kPointer, "arms"}, 500);
  options.known.add(
      {"arms", "four arms", [] { return std::make_unique<FourArms>(); }, [] { return DeviceReport(); }});
  const auto five = explore(loaded_, Script(), options, "");
  ASSERT_FALSE(five.ok());
  EXPECT_THAT(five.error().message(), HasSubstr("5 devices are connected"));
}

}  // namespace
}  // namespace palpate
