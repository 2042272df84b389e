#include "palpate/doctor/grip_trial.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>
#include <utility>

#include "doctor/grip_trial_servo.h"
#include "palpate/device/bounds.h"
#include "palpate/device/simulated_device.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

std::int64_t trial_ns = 0;

/// A trial on a virtual clock with a simulated hand that holds its position.
GripTrialFigures tried(const char* device, const char* hand, double delay_s, GripTrialSettings settings = {},
                       double* largest_N = nullptr, GripTrial::EndReason* ended = nullptr) {
  SimulatedDevice plant(*find_plant_device(device), *find_plant_hand(hand), delay_s);
  plant.reset(Point<Device>(3, -2, 10));
  trial_ns = 1'000'000'000;
  GripTrial trial(settings, settings.rate_hz, plant.info().position_step_mm.value_or(0.06),
                  []() noexcept { return trial_ns; });
  DeviceCommand command;
  for (int n = 0; n < 60 * settings.rate_hz && trial.ended() == GripTrial::EndReason::kNone; ++n) {
    DeviceSample sample = plant.read();
    sample.taken_ns = trial_ns;
    trial.update({&sample, 1}, {&command, 1});
    if (largest_N) *largest_N = std::max(*largest_N, command.force_N.norm());
    plant.advance(command, 1 / settings.rate_hz);
    trial_ns += std::llround(1e9 / settings.rate_hz);
  }
  if (ended) *ended = trial.ended();
  const auto figures = trial.figures();
  EXPECT_TRUE(figures) << device << ' ' << hand;
  return figures.value_or(GripTrialFigures{});
}

struct GripTrialCase {
  const char *device, *hand;
  double delay_s;
};
class GripTrials : public ::testing::TestWithParam<GripTrialCase> {};
INSTANTIATE_TEST_SUITE_P(Each, GripTrials,
                         ::testing::Values(GripTrialCase{"premium-1.5", "light-grip", 0.002},
                                           GripTrialCase{"premium-1.5", "firm-grip", 0.003},
                                           GripTrialCase{"touch", "light-grip", 0.005},
                                           GripTrialCase{"touch", "firm-grip", 0},
                                           GripTrialCase{"premium-1.5", "light-grip", 0.008}),
                         [](const auto& tested) { return "case" + std::to_string(tested.index); });

// compared with the simulation's parameters: its latency, and stability at the advised stiffness
TEST_P(GripTrials, AreDistinguishedByDelayAndStiffness) {
  const GripTrialCase& tested = GetParam();
  double largest_N = 0;
  GripTrial::EndReason ended = GripTrial::EndReason::kNone;
  const GripTrialFigures figures = tried(tested.device, tested.hand, tested.delay_s, {}, &largest_N, &ended);
  EXPECT_EQ(ended, GripTrial::EndReason::kDone);
  EXPECT_NEAR(figures.delay_s, tested.delay_s, 0.001);
  EXPECT_NEAR(figures.rate_hz, 1000, 1);
  EXPECT_LE(largest_N, 1 + 1e-12);
  EXPECT_GT(figures.stable_N_per_mm, 0.09);
  if (figures.oscillating_N_per_mm) {
    EXPECT_NEAR(*figures.oscillating_N_per_mm / figures.stable_N_per_mm, 1.15, 1e-9) << "the next one";
    EXPECT_NEAR(figures.recommended_N_per_mm, kStiffnessMargin * *figures.oscillating_N_per_mm, 1e-12);
  }
}

// latency reduces the stable stiffness as b / (T/2 + t)
TEST(GripTrialOfDevice, ALongerDelayHoldsLess) {
  const auto at = [](double delay_s) { return tried("premium-1.5", "light-grip", delay_s).stable_N_per_mm; };
  const double none = at(0), some = at(0.004), much = at(0.012);
  EXPECT_GT(none, some);
  EXPECT_GT(some, much);
  EXPECT_TRUE(tried("premium-1.5", "light-grip", 0.012).oscillating_N_per_mm);
}

TEST(GripTrialOfDevice, NothingIsPushedWhereSomethingIsWrong) {
  // result for an invalid sample that is processed some time after it was taken
  const auto after = [](const DeviceSample& wrong, std::int64_t later_ns, std::int64_t taken_later_ns = 0) {
    trial_ns = 1'000'000'000;
    GripTrial trial({}, 1000, 0.05, []() noexcept { return trial_ns; });
    DeviceSample sample;
    DeviceCommand command;
    for (int n = 0; n < 700; ++n, trial_ns += 1'000'000) {
      sample.taken_ns = trial_ns;
      trial.update({&sample, 1}, {&command, 1});
    }
    EXPECT_GT(command.force_N.norm(), 0.1) << "it pushes by now";
    DeviceSample then = wrong;
    then.taken_ns = trial_ns + taken_later_ns;
    trial_ns += later_ns;
    trial.update({&then, 1}, {&command, 1});
    EXPECT_EQ(command.force_N, Vector<Device>());
    // the force stays zero
    sample.taken_ns = trial_ns;
    trial.update({&sample, 1}, {&command, 1});
    EXPECT_EQ(command.force_N, Vector<Device>());
    return trial.ended();
  };
  DeviceSample wrong;
  wrong.fault = true;
  EXPECT_EQ(after(wrong, 0), GripTrial::EndReason::kFault);
  wrong = {};
  wrong.tip = Point<Device>(std::nan(""), 0, 0);
  EXPECT_EQ(after(wrong, 0), GripTrial::EndReason::kNotFinite);
  wrong = {};
  wrong.tip = Point<Device>(0, 16, 0);
  EXPECT_EQ(after(wrong, 0), GripTrial::EndReason::kMovedAway);
  wrong.tip = Point<Device>(5, 0, 0);
  EXPECT_EQ(after(wrong, 0), GripTrial::EndReason::kTooFast);
  EXPECT_EQ(after({}, 11'000'000), GripTrial::EndReason::kStaleSample);
  EXPECT_EQ(after({}, 9'000'000, 9'000'000), GripTrial::EndReason::kLate) << "10 ms after the tick before";
  EXPECT_EQ(after({}, 0, 2'000'000), GripTrial::EndReason::kBadTimestamps) << "from the future";
  EXPECT_EQ(after({}, 0, -2'000'000), GripTrial::EndReason::kBadTimestamps) << "older than the one before";
}

/// Result and end time, s, of a trial whose tip follows mm_at(time) along y.
template <class Trajectory>
std::pair<GripTrial::EndReason, double> guided(Trajectory mm_at, double step_mm = 0.05,
                                               double rate_hz = 1000) {
  trial_ns = 1'000'000'000;
  GripTrial trial({}, rate_hz, step_mm, []() noexcept { return trial_ns; });
  DeviceSample sample;
  DeviceCommand command;
  double time_s = 0;
  for (; time_s < 30 && trial.ended() == GripTrial::EndReason::kNone; time_s += 1 / rate_hz) {
    sample.taken_ns = trial_ns;
    sample.tip = Point<Device>(0, mm_at(time_s), 0);
    trial.update({&sample, 1}, {&command, 1});
    trial_ns += std::llround(1e9 / rate_hz);
  }
  return {trial.ended(), time_s};
}

// averaged over 8 ms, whatever the rate and the resolution of the encoder
TEST(GripTrialOfDevice, ItsSpeedIsBounded) {
  const auto moves = [](double mm_s) {
    return [=](double time_s) { return time_s < 1 ? 0.0 : std::min(14.0, mm_s * (time_s - 1)); };
  };
  for (const double rate_hz : {250.0, 1000.0, 10000.0})
    for (const double step_mm : {0.001, 0.05, 1e9, -1.0, std::nan("")}) {
      SCOPED_TRACE(std::to_string(rate_hz) + " Hz, " + std::to_string(step_mm) + " mm");
      const auto [fast, at_s] = guided(moves(550), step_mm, rate_hz);
      EXPECT_EQ(fast, GripTrial::EndReason::kTooFast);
      EXPECT_LT(at_s, 1.015);
      EXPECT_NE(guided(moves(450), step_mm, rate_hz).first, GripTrial::EndReason::kTooFast);
    }
}

// the springs' rest position follows a drifting hand, but not indefinitely
TEST(GripTrialOfDevice, ItsWayIsBoundedFromWhereItRestedFirst) {
  const auto [ended, at_s] = guided([](double time_s) { return std::max(0.0, 5 * (time_s - 2.5)); });
  EXPECT_EQ(ended, GripTrial::EndReason::kMovedAway);
  EXPECT_NEAR(at_s, 5.5, 0.01);
}

TEST(GripTrialOfDevice, ItBeginsSoonOrNotAtAll) {
  trial_ns = 1'000'000'000;
  GripTrial trial({}, 1000, 0.05, []() noexcept { return trial_ns; });
  DeviceSample sample;
  DeviceCommand command;
  sample.fault = true;
  for (int n = 0; n < 2010; ++n, trial_ns += 1'000'000) {
    sample.taken_ns = trial_ns;
    trial.update({&sample, 1}, {&command, 1});
  }
  EXPECT_EQ(trial.ended(), GripTrial::EndReason::kNotReady);
  // the fault ends
  sample.fault = false;
  for (int n = 0; n < 1000; ++n, trial_ns += 1'000'000) {
    sample.taken_ns = trial_ns;
    trial.update({&sample, 1}, {&command, 1});
    ASSERT_EQ(command.force_N, Vector<Device>());
  }
}

// the pushes have zero mean
TEST(GripTrialOfDevice, ThePushesHaveNoMean) {
  trial_ns = 1'000'000'000;
  GripTrial trial({}, 1000, 0.05, []() noexcept { return trial_ns; });
  DeviceSample sample;
  DeviceCommand command;
  double sum_N = 0, size_N = 0;
  for (int n = 0; n < 2499; ++n, trial_ns += 1'000'000) {
    sample.taken_ns = trial_ns;
    trial.update({&sample, 1}, {&command, 1});
    if (n >= 500 + std::lround(3 * 1e3 * GripTrial::kPushPeriod_s)) continue;
    sum_N += command.force_N.x();
    size_N += std::abs(command.force_N.x());
  }
  EXPECT_NEAR(size_N, 0.8 * 3e3 * GripTrial::kPushPeriod_s, 0.01);
  // a change that falls between two ticks contributes an error of up to two ticks
  EXPECT_LT(std::abs(sum_N), 0.01 * size_N);
}

TEST(GripTrialOfDevice, OscillationAtTheFirstStiffnessEndsTheTrial) {
  SimulatedDevice plant(*find_plant_device("premium-1.5"), *find_plant_hand("light-grip"), 0.012);
  plant.reset(Point<Device>(0, 0, 0));
  trial_ns = 1'000'000'000;
  GripTrialSettings settings;
  settings.first_N_per_mm = 3;
  GripTrial trial(settings, 1000, 0.03, []() noexcept { return trial_ns; });
  DeviceCommand command;
  while (trial.ended() == GripTrial::EndReason::kNone && trial_ns < 30'000'000'000) {
    DeviceSample sample = plant.read();
    sample.taken_ns = trial_ns;
    trial.update({&sample, 1}, {&command, 1});
    plant.advance(command, 0.001);
    trial_ns += 1'000'000;
  }
  EXPECT_EQ(trial.ended(), GripTrial::EndReason::kOscillated);
}

TEST(GripTrialOfDevice, IsTriedOnTheRealClock) {
  SimulatedDevice plant(*find_plant_device("touch"), *find_plant_hand("light-grip"), 0.012);
  plant.reset(Point<Device>(0, 0, 0));
  SimulatedDriver driver(plant);
  GripTrialSettings settings;
  settings.realtime = false;
  settings.growth = 2;
  settings.first_N_per_mm = 0.2;
  settings.max_N_per_mm = 0.4;
  const auto figures = run_grip_trial(driver, settings);
  // on a loaded machine the trial may be aborted for lateness, and reports so
  if (!figures) {
    EXPECT_EQ(figures.error().kind, ErrorKind::kUnavailable);
    EXPECT_FALSE(figures.error().remedy.empty());
    return;
  }
  EXPECT_NE(figures->device, "");
  EXPECT_GT(figures->rate_hz, 100);
  EXPECT_NEAR(figures->delay_s, 0.012, 0.003);

  const std::atomic<bool> stop{true};
  const auto stopped = run_grip_trial(driver, settings, Progress({}, &stop));
  ASSERT_FALSE(stopped.ok());
  EXPECT_EQ(stopped.error().kind, ErrorKind::kInterrupted);
}

// driver with a scripted behaviour
class DeclaringDriver final : public DeviceDriver {
 public:
  explicit DeclaringDriver(const DeviceInfo& info) : info_(info) {}
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool /*may_move*/) override { return {}; }
  void run(ServoFunction& /*servo*/, ServoClock& clock) noexcept override {
    while (!clock.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    // takes time to end
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    if (!heartbeat) return;
    const std::int64_t checked_ns = heartbeat->checked_ns;
    for (int n = 0; n < 5000 && !sampled_on; ++n) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      sampled_on = heartbeat->checked_ns != checked_ns;
    }
  }
  void halt() noexcept override { halted = true; }
  void resume(std::uint64_t /*newest*/) noexcept override {}
  std::optional<Error> failure() const override { return wrong; }

  Heartbeat* heartbeat = nullptr;
  std::atomic<bool> sampled_on{false}, halted{false};
  std::optional<Error> wrong;

 private:
  DeviceInfo info_;
};

// a trial starts soon after arming or not at all; the heartbeat continues meanwhile
TEST(GripTrialOfDevice, ADriverThatDoesNotBeginIsNotWaitedFor) {
  for (const bool says : {true, false}) {
    SCOPED_TRACE(says);
    DeviceInfo info;
    info.name = "arm";
    DeclaringDriver driver(info);
    if (says) driver.wrong = Error{ErrorKind::kUnavailable, "the brake is on", "arm", "press the pedal"};
    Heartbeat heartbeat;
    driver.heartbeat = &heartbeat;
    GripTrialSettings settings;
    settings.realtime = false;
    settings.heartbeat = &heartbeat;
    const auto figures = run_grip_trial(driver, settings);
    ASSERT_FALSE(figures.ok());
    EXPECT_EQ(figures.error().kind, ErrorKind::kUnavailable);
    EXPECT_THAT(figures.error().what, HasSubstr(says ? "the brake is on" : "not ready"));
    EXPECT_FALSE(figures.error().remedy.empty());
    EXPECT_TRUE(driver.halted);
    EXPECT_TRUE(driver.sampled_on) << "while it ended";
    EXPECT_EQ(heartbeat.beat_ns, Heartbeat::kResting);
    EXPECT_EQ(heartbeat.checked_ns, Heartbeat::kResting);
  }
}

TEST(GripTrialOfDevice, IsStoredAsText) {
  const GripFiguresByDevice hands{{"Touch no. 4711", {"Touch no. 4711", 1000, 0.0025, 0.8, 0.92, 0.552}},
                                  {"omega.3", {"omega.3", 4000, 0.001, 2, {}, 1.2}}};
  const auto read = parse_grip_figures(grip_figures_text(hands), "held");
  ASSERT_TRUE(read.ok()) << read.error().message();
  ASSERT_EQ(read->size(), 2u);
  const GripTrialFigures& touch = read->at("Touch no. 4711");
  EXPECT_EQ(touch.rate_hz, 1000);
  EXPECT_EQ(touch.delay_s, 0.0025);
  EXPECT_EQ(touch.stable_N_per_mm, 0.8);
  EXPECT_EQ(touch.oscillating_N_per_mm, 0.92);
  EXPECT_NEAR(touch.recommended_N_per_mm, 0.552, 1e-12);
  EXPECT_FALSE(read->at("omega.3").oscillating_N_per_mm);
  EXPECT_NEAR(read->at("omega.3").recommended_N_per_mm, 1.2, 1e-12);
  for (const char* bad :
       {"1000 0.002 1 1.1", "x 0.002 1 1.1 A", "1000 -1 1 1.1 A", "1000 0.002 nan - A", "1000 0.002 1e9 - A",
        "1000 1 1 - A", "1000 0.002 1 + A", " ", "1000 0 1 - A\n1000 0 1 - A", "200 0.002 1 1.1 A",
        "1000 0.021 1 1.1 A", "1000 0.002 0 - A", "1000 0.002 1 0 A", "1000 0.002 1 0.9 A",
        "1000 0.002 1 5.1 A", "1000 0.002 5.1 - A", "1000 0.002 1 1.1 A\x1b[2J", "1000 0.002 1 1.1 A\r\r"}) {
    const auto refused = parse_grip_figures(std::string("# fine\n") + bad, "held");
    ASSERT_FALSE(refused.ok()) << bad;
    EXPECT_THAT(refused.error().where, HasSubstr("held:")) << bad;
    EXPECT_FALSE(refused.error().remedy.empty());
  }
  const auto of_windows = parse_grip_figures("# fine\r\n\r\n1000 0.002 1 1.1 arm\r\n", "held");
  ASSERT_TRUE(of_windows.ok()) << of_windows.error().message();
  EXPECT_TRUE(of_windows->contains("arm"));
}

// the measurement, the vendor's limit and a slower loop all bound the device
TEST(GripTrialOfDevice, BoundsTheDeviceThatItWasMeasuredWith) {
  const GripFiguresByDevice hands{{"arm", {"arm", 1000, 0.0015, 1, 1.15, 0.69}}};
  const auto declared = [&](const DeviceInfo& info, double rate_hz) {
    const auto driver = with_grip_figures(std::make_unique<DeclaringDriver>(info), hands, rate_hz);
    EXPECT_TRUE(driver->open(false).ok());
    return driver->devices()[0];
  };
  DeviceInfo info;
  info.name = "arm";
  EXPECT_EQ(declared(info, 1000).stiffness_N_per_mm, 0.69);
  EXPECT_EQ(declared(info, 1000).delay_s, 0.0015);
  info.delay_s = 0.001;
  EXPECT_EQ(declared(info, 1000).delay_s, 0.0015);
  info.delay_s = 0.004;
  EXPECT_EQ(declared(info, 1000).delay_s, 0.004) << "the maker's word";
  EXPECT_FALSE(declared(info, 500).stiffness_N_per_mm) << "a slower loop holds less";
  info.stiffness_N_per_mm = 0.5;
  EXPECT_EQ(declared(info, 1000).stiffness_N_per_mm, 0.5) << "the maker's word";
  info.stiffness_N_per_mm = 2;
  EXPECT_EQ(declared(info, 1000).stiffness_N_per_mm, 0.69);
  info.stiffness_N_per_mm = {};
  info.name = "another";
  EXPECT_FALSE(declared(info, 1000).stiffness_N_per_mm);
  info.name = "arm";
  info.simulated = true;
  EXPECT_FALSE(declared(info, 1000).stiffness_N_per_mm);
}

}  // namespace
}  // namespace palpate
