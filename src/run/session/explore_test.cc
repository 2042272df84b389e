// Sessions on the real clock. Latency depends on the machine, so no test here requires any.
#include "palpate/session/explore.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <set>

#include "loading/test_loading.h"
#include "palpate/direct/direct_methods.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::loaded_ball;

// longer than any session here takes on an idle machine
constexpr double kPatience_s = 30;

Script script_of(const std::string& steps) {
  auto script = parse_script(steps, "test script");
  PALPATE_CHECK(script.ok());
  return *script;
}

// brief: approach, press, hold for several status periods, rotate, leave
const char* const kTouch =
    "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\npress = 0.8\nsettle = 0.1\n"
    "[[step]]\nhold = 1.0\n[[step]]\nrotate = 4.0\nseconds = 0.2\n[[step]]\nleave = true\nspeed = 200.0\n";
const char* const kPress =
    "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nhold = 60.0\n";
const char* const kPass =
    "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\nleave = true\nspeed = 200.0\n";

double force_N(const TickRecord& tick) {
  const auto& f = tick.device[0].force_N;
  return Eigen::Vector3d(f[0], f[1], f[2]).norm();
}

class Explore : public ::testing::Test {
 protected:
  // runs a session, reads its recording and checks that it replays
  ExploreResult run(const Script& script, const ExploreOptions& options,
                    const std::function<void(const ExploreStatus&)>& status = {}) {
    const auto file = folder_ / "run.h5";
    // ring large enough for the whole run, in case the recorder's thread is delayed
    ExploreOptions roomy = options;
    roomy.loop.ring_s = std::min(kPatience_s, 2e4 / options.run.rate_hz.value_or(1000));
    auto result = explore(loaded_, script, roomy, file, Progress({}, &stop_), status);
    PALPATE_CHECK(result.ok());
    auto read = read_recording(file);
    PALPATE_CHECK(read.ok());
    recording_ = std::move(*read);
    expect_whole(*result);
    return std::move(*result);
  }

  void expect_whole(const ExploreResult& result) {
    EXPECT_FALSE(result.recording_failure);
    EXPECT_EQ(result.health.dropped, 0u);
    EXPECT_EQ(result.summary.ticks, result.health.ticks);
    EXPECT_EQ(recording_.ticks.size(), result.health.ticks);
    ASSERT_TRUE(recording_.summary);
    EXPECT_EQ(recording_.summary->run_hash, result.summary.run_hash);
    EXPECT_EQ(recording_.summary->skipped, result.health.skipped);
    EXPECT_EQ(recording_.header.clock, "real");
    EXPECT_EQ(recording_.header.scheduler, result.scheduling.scheduler);
    EXPECT_FALSE(result.scheduling.scheduler.empty());
    const auto again = replay(recording_, loaded_.model);
    ASSERT_TRUE(again.ok()) << again.error().message();
    EXPECT_TRUE(again->identical) << again->difference;
    EXPECT_EQ(again->run_hash, result.summary.run_hash);
  }

  // every nominal tick time has its tick or is counted as skipped
  void expect_on_the_grid(const ExploreResult& result, double rate_hz) {
    double elapsed_s = 0;
    for (std::size_t t = 1; t < recording_.ticks.size(); ++t) elapsed_s += recording_.ticks[t].dt_s;
    const double late = result.health.lateness.max_us * 1e-6 * rate_hz;
    EXPECT_NEAR(static_cast<double>(result.health.ticks - 1 + result.health.skipped), elapsed_s * rate_hz,
                1.5 + late);
  }

  test::TemporaryFolder folder_;
  LoadedScene loaded_ = loaded_ball();
  std::atomic<bool> stop_{false};
  Recording recording_;
};

TEST_F(Explore, TouchesTheBallInRealTimeAndReplays) {
  ExploreOptions options;
  options.seconds = kPatience_s;
  double last_s = -1, largest_N = 0;
  bool touched = false;
  const auto result = run(script_of(kTouch), options, [&](const ExploreStatus& status) {
    EXPECT_GT(status.time_s, last_s);
    EXPECT_FALSE(status.scheduling.scheduler.empty());
    last_s = status.time_s;
    largest_N = std::max(largest_N, status.force_N);
    touched = touched || status.structure == "ball";
  });
  EXPECT_FALSE(result.stopped_by_user);
  expect_on_the_grid(result, 1000);
  EXPECT_TRUE(std::isfinite(recording_.ticks.front().device[0].max_stiffness_N_per_mm))
      << "what a hand holds is known to the loop";
  EXPECT_TRUE(touched);
  EXPECT_GT(largest_N, 0.4);
  ASSERT_EQ(result.holds.size(), 1u);
  EXPECT_EQ(result.holds[0].structure, "ball");
  EXPECT_GT(result.holds[0].peak_force_N, 0.6);
  EXPECT_GE(result.max_force_N, result.holds[0].peak_force_N);
  EXPECT_LE(result.max_force_N, result.limit_N);

  // the rotation reached the servo
  const auto& turned = recording_.ticks.back().rotation_target_wxyz;
  EXPECT_NEAR(2 * std::acos(turned[0]) * 180 / M_PI, 4, 1e-6);
}

TEST_F(Explore, ABurrsMotorAndStrokesAreAskedForByKeys) {
  loaded_ = testing::loaded_burr();
  ExploreOptions options;
  options.seconds = kPatience_s;
  // the pressed surface may have been removed
  options.repeat = true;
  // the next request follows once the last was accepted and some time has passed
  const ExploreRequest request[] = {ExploreRequest::kUndoStroke, ExploreRequest::kMotor,
                                    ExploreRequest::kMotor,      ExploreRequest::kUndoStroke,
                                    ExploreRequest::kRedoStroke, ExploreRequest::kNone};
  std::size_t at = 0;
  bool touched = false, ask = false;
  double requested_s = 0;
  std::vector<std::string> refused;
  options.request = [&] { return std::exchange(ask, false) ? request[at++] : ExploreRequest::kNone; };
  const auto result = run(script_of(kPress), options, [&](const ExploreStatus& status) {
    touched = touched || status.structure == "ball";
    if (status.refusal) {
      refused.push_back(status.refusal->what);
      // the first undo precedes any stroke; the sweeps of a stroke may still be being removed
      if (at > 1) --at;
    }
    if (!touched || status.time_s < requested_s + 0.6) return;
    requested_s = status.time_s;
    ask = at < std::size(request);
    if (at == std::size(request)) stop_.store(true);
  });
  EXPECT_TRUE(result.stopped_by_user);
  ASSERT_GE(refused.size(), 1u);
  EXPECT_EQ(refused[0], "there is no stroke to undo");
  std::vector<std::uint32_t> strokes;
  std::vector<bool> motor;
  std::size_t sweeps = 0;
  for (const RecordingEvent& event : recording_.events) {
    sweeps += event.kind == RecordingEvent::Kind::kSweep ? 1 : 0;
    if (event.kind == RecordingEvent::Kind::kModel && event.change.is_of_stroke()) {
      EXPECT_EQ(event.by.originator, Originator::kKey);
      strokes.push_back(event.change.tissue);
    }
    if (event.by.originator == Originator::kKey && (event.changed & kSettingMotor) != 0)
      motor.push_back((event.switches & kSwitchMotor) != 0);
  }
  EXPECT_GT(sweeps, 0u);
  EXPECT_THAT(motor, ::testing::ElementsAre(true, false));
  EXPECT_THAT(strokes,
              ::testing::ElementsAre(std::uint32_t{ModelChange::kUndo}, std::uint32_t{ModelChange::kRedo}));
}

TEST_F(Explore, AProbeHasNoMotor) {
  ExploreOptions options;
  options.seconds = kPatience_s;
  int requested = 0;
  options.request = [&] {
    ++requested;
    return requested == 2 ? ExploreRequest::kMotor : ExploreRequest::kNone;
  };
  std::string refused;
  run(script_of(kPass), options, [&](const ExploreStatus& status) {
    if (status.refusal) refused = status.refusal->what;
  });
  EXPECT_EQ(refused, "no device has a tool with a motor");
}

TEST_F(Explore, TheMethodChangesWhenAskedInACircle) {
  ExploreOptions options;
  options.seconds = kPatience_s;
  options.repeat = true;
  // polled fifty times a second: a few requests while the ball is in contact, each after the last took effect
  int requested = 0;
  bool waits = false;
  options.request = [&] {
    return ++requested % 12 == 0 && !waits ? ExploreRequest::kNextMethod : ExploreRequest::kNone;
  };
  std::vector<ForceMethod> shown;
  const auto result = run(script_of(kTouch), options, [&](const ExploreStatus& status) {
    waits = status.method_awaited.has_value();
    if (shown.empty() || shown.back() != status.method) shown.push_back(status.method);
    // about three seconds, longer on a slow machine
    if (status.time_s > 2.5 && shown.size() > 2) stop_.store(true);
  });
  EXPECT_EQ(result.summary.method_missing, 0u) << "each is felt when it is there";
  EXPECT_GE(shown.size(), 2u);
  std::set<ForceMethod> methods;
  for (const TickRecord& tick : recording_.ticks) methods.insert(static_cast<ForceMethod>(tick.method));
  EXPECT_GE(methods.size(), 2u);
  EXPECT_TRUE(methods.contains(ForceMethod::kSpline)) << "the one after the first";
}

// Checks the fade-out from the tick with the pause on: the force never exceeds the ramp's share of the
// demanded and permitted force, and no step exceeds the ramp's plus that of the demand. Returns the force
// before it.
double expect_fading(const std::vector<TickRecord>& ticks, double limit_N) {
  const auto pause = std::find_if(ticks.begin(), ticks.end(),
                                  [](const TickRecord& tick) { return tick.switches & kSwitchPaused; });
  if (pause == ticks.begin() || pause == ticks.end()) {
    ADD_FAILURE() << "nothing before or after the stop";
    return 0;
  }
  double faded_s = 0;
  for (auto tick = pause; tick != ticks.end(); ++tick) {
    const DeviceTick& now = tick->device[0];
    const DeviceTick& before = (tick - 1)->device[0];
    faded_s += tick->dt_s;
    const double left = std::max(0.0, 1 - faded_s / kOutputSettings.ramp_out_s);
    EXPECT_LE(force_N(*tick), left * now.unclamped_force_N + 1e-9);
    EXPECT_LE(force_N(*tick), limit_N);
    // force is zero at once if the loop stalls, and its return is another step; the same holds for ticks in
    // which the passivity controller dissipates
    constexpr std::uint32_t kWithheld = kFaultFlags | kFlagStale | kFlagSlew | kFlagPassivity;
    if (((now.flags | before.flags) & kWithheld) != 0) continue;
    const double ramp_N = tick->dt_s / kOutputSettings.ramp_out_s * before.unclamped_force_N;
    const double requested_N = std::abs(now.unclamped_force_N - before.unclamped_force_N);
    EXPECT_LE(std::abs(force_N(*tick) - force_N(*(tick - 1))), ramp_N + requested_N + 1e-9);
  }
  EXPECT_EQ(force_N(ticks.back()), 0);
  return force_N(*(pause - 1));
}

TEST_F(Explore, StoppedInMidPressTheForceFadesOut) {
  ExploreOptions options;
  options.seconds = kPatience_s;
  // a hand whose thread is delayed bounces on the surface, and may be stopped out of contact
  double pressed_N = 0;
  for (int attempt = 0; attempt < 5 && pressed_N < 0.3; ++attempt) {
    stop_.store(false);
    const auto result = run(script_of(kPress), options, [&](const ExploreStatus& status) {
      if (status.force_N > 0.5) stop_.store(true);
    });
    EXPECT_TRUE(result.stopped_by_user);
    pressed_N = expect_fading(recording_.ticks, result.limit_N);
  }
  EXPECT_GE(pressed_N, 0.3);
}

// force is given back only to a free tip: the hand withdraws by itself and resumes
TEST_F(Explore, StoppedHandWithdrawsAndReturns) {
  ExploreOptions options;
  options.seconds = kPatience_s;
  ExploreStatus observed;
  int stops = 0, shown_since = 0;
  bool rearmed = false;
  options.request = [&] {
    // three stop requests: each only stops
    if (stops < 3 && (stops > 0 || observed.force_N > 0.5)) {
      shown_since = 0;
      return ++stops, ExploreRequest::kEmergencyStop;
    }
    return stops == 3 && shown_since > 1 && observed.stop ? ExploreRequest::kRearm : ExploreRequest::kNone;
  };
  const auto result = run(script_of(kPress), options, [&](const ExploreStatus& status) {
    observed = status;
    if (status.refusal) {
      // the key is pressed repeatedly until the status shows its effect
      EXPECT_THAT(status.refusal->what,
                  ::testing::AnyOf(HasSubstr("is in contact"), HasSubstr("not stopped")));
    }
    shown_since += stops == 3;
    rearmed = rearmed || (shown_since > 2 && !status.stop);
    if (rearmed && status.force_N > 0.5) stop_.store(true);
  });
  EXPECT_TRUE(result.stopped_by_user) << "it never came back";
  const auto& ticks = recording_.ticks;
  const auto is_stopped = [](const TickRecord& tick) { return (tick.switches & kSwitchEmergencyStop) != 0; };
  const auto stopped = std::find_if(ticks.begin(), ticks.end(), is_stopped);
  const auto again = std::find_if_not(stopped, ticks.end(), is_stopped);
  ASSERT_NE(again, ticks.end());
  EXPECT_TRUE((stopped - 1)->device[0].flags & kFlagContact);
  for (auto tick = stopped; tick != again; ++tick) EXPECT_EQ(force_N(*tick), 0);
  EXPECT_FALSE((again - 1)->device[0].flags & (kFlagContact | kFlagInside));
  std::vector<std::pair<RecordingEvent::Kind, Originator>> reported;
  for (const RecordingEvent& event : recording_.events)
    if (event.kind == RecordingEvent::Kind::kStop || event.kind == RecordingEvent::Kind::kRearm)
      reported.emplace_back(event.kind, event.by.originator);
  using Kind = RecordingEvent::Kind;
  EXPECT_EQ(reported, (decltype(reported){{Kind::kStop, Originator::kKey},
                                          {Kind::kStop, Originator::kKey},
                                          {Kind::kStop, Originator::kKey},
                                          {Kind::kRearm, Originator::kKey}}));
}

TEST_F(Explore, EndsAfterItsTime) {
  ExploreOptions options;
  options.seconds = 0.2;
  const auto result = run(script_of(kPress), options);
  EXPECT_FALSE(result.stopped_by_user);
  EXPECT_GE(recording_.ticks.back().time_s, 0.19);
}

TEST_F(Explore, RepeatsUntilStopped) {
  ExploreOptions options;
  options.seconds = kPatience_s;
  options.repeat = true;
  double progress = 0;
  int rounds = 0;
  const auto result = run(script_of(kPass), options, [&](const ExploreStatus& status) {
    rounds += status.progress < progress;
    progress = status.progress;
    if (rounds == 2) stop_.store(true);
  });
  EXPECT_TRUE(result.stopped_by_user);
  EXPECT_EQ(rounds, 2);
}

class ExploreRates : public Explore, public ::testing::WithParamInterface<double> {};

TEST_P(ExploreRates, TicksAtTheRateThatIsAsked) {
  ExploreOptions options;
  options.run.rate_hz = GetParam();
  options.seconds = 0.15;
  const auto result = run(script_of(kPress), options);
  EXPECT_EQ(recording_.header.rate_hz, GetParam());
  expect_on_the_grid(result, GetParam());
}

INSTANTIATE_TEST_SUITE_P(Rates, ExploreRates, ::testing::Values(250.0, 4000.0, 10000.0));

TEST_F(Explore, WithoutARecordingItStillCounts) {
  ExploreOptions options;
  options.seconds = 0.1;
  const auto result = explore(loaded_, script_of(kPress), options, "");
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_GT(result->summary.ticks, 0u);
  EXPECT_EQ(result->summary.ticks, result->health.ticks);
  EXPECT_FALSE(result->recording_failure);
}

// a viewer who moves the tip may look on; a scripted hand has nothing to touch
TEST_F(Explore, PointerObservesASceneWithoutTouchableTissue) {
  Model model = *loaded_.model;
  for (Tissue& tissue : model.tissues) tissue.touchable = false;
  std::fill(model.level_of_label.begin(), model.level_of_label.end(), 0.f);
  model.methods = {};
  auto shown =
      with_methods(std::make_shared<const Model>(std::move(model)), std::array{ForceMethod::kTrilinear});
  ASSERT_TRUE(shown.ok());
  loaded_.model = *shown;
  ExploreOptions options;
  options.seconds = 0.2;
  EXPECT_FALSE(explore(loaded_, script_of(kPass), options, "").ok());
  options.devices = {kPointer};
  const auto result = explore(loaded_, Script{}, options, "");
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_GT(result->health.ticks, 0u);
  EXPECT_EQ(result->max_force_N, 0);
  EXPECT_EQ(result->summary.method_missing, 0u);
}

TEST_F(Explore, ReportsSetupErrors) {
  const auto error_of = [&](const Script& script, const ExploreOptions& options, const std::string& file) {
    const auto result = explore(loaded_, script, options, file, Progress({}, &stop_));
    PALPATE_CHECK(!result.ok());
    return result.error();
  };
  EXPECT_THAT(error_of(script_of("device = \"spoon\"\n" + std::string(kPress)), {}, "").where,
              HasSubstr("test script:1"));
  EXPECT_THAT(error_of(script_of("[[step]]\napproach = \"cube\"\n"), {}, "").what, HasSubstr("cube"));
  ExploreOptions slow;
  slow.run.rate_hz = 100;
  EXPECT_EQ(error_of(script_of(kPress), slow, folder_ / "run.h5").kind, ErrorKind::kUsage);
  EXPECT_EQ(error_of(script_of(kPress), {}, folder_ / "missing" / "run.h5").kind, ErrorKind::kOutput);
  stop_.store(true);
  EXPECT_EQ(error_of(script_of(kPress), {}, folder_ / "run.h5").kind, ErrorKind::kInterrupted);
  EXPECT_EQ(folder_.count(), 0u);
}

}  // namespace
}  // namespace palpate
