#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>

#include "session/test_viewed.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::sent_N;

class ViewedExplore : public ::testing::Test {
 protected:
  // calls `act` fifty times a second with the session; returns its recording
  Recording run(ExploreOptions options, const std::string& script_text,
                const std::function<void(LiveHost&, int)>& act) {
    LiveHost* host = nullptr;
    int calls = 0;
    options.loop.realtime = false;
    options.viewers = [&](LiveHost& session) -> Result<std::shared_ptr<void>> {
      host = &session;
      return std::shared_ptr<void>(&session, [&](void*) { host = nullptr; });
    };
    options.request = [&] {
      act(*host, calls++);
      return ExploreRequest::kNone;
    };
    auto script = parse_script(script_text, "test script");
    PALPATE_CHECK(script.ok());
    const auto file = folder_ / "run.h5";
    auto result = explore(loaded_, *script, options, file, Progress({}, &stop_));
    PALPATE_CHECK(result.ok());
    result_ = *result;
    EXPECT_EQ(host, nullptr) << "viewers leave before the session ends";
    auto read = read_recording(file);
    PALPATE_CHECK(read.ok() && read->summary);
    return *std::move(read);
  }
  static std::vector<ModelChange> changes_in(const Recording& recording) {
    std::vector<ModelChange> changes;
    for (const RecordingEvent& event : recording.events)
      if (event.kind == RecordingEvent::Kind::kModel) changes.push_back(event.change);
    return changes;
  }
  static ModelChange& first_change(Recording& recording) {
    return std::find_if(
               recording.events.begin(), recording.events.end(),
               [](const RecordingEvent& event) { return event.kind == RecordingEvent::Kind::kModel; })
        ->change;
  }
  // each event is recorded with the first tick to which its values apply; several events of one tick with the
  // last values
  static void expect_events_where_they_took_hold(const Recording& recording) {
    for (std::size_t e = 0; e < recording.events.size(); ++e) {
      const RecordingEvent& event = recording.events[e];
      const TickRecord& tick = recording.ticks.at(event.tick);
      ASSERT_EQ(tick.tick, event.tick);
      if (event.kind == RecordingEvent::Kind::kModel) {
        EXPECT_GE(tick.model_version, event.number);
        EXPECT_LT(recording.ticks.at(event.tick - 1).model_version, event.number);
      }
      const bool last = std::none_of(
          recording.events.begin() + static_cast<std::ptrdiff_t>(e) + 1, recording.events.end(),
          [&](const RecordingEvent& later) { return later.kind == event.kind && later.tick == event.tick; });
      if (event.kind != RecordingEvent::Kind::kSettings || !last) continue;
      EXPECT_EQ(tick.method, event.method);
      EXPECT_EQ(tick.switches & ~kSwitchEmergencyStop, event.switches);
      EXPECT_EQ(tick.max_force_N, event.max_force_N);
      EXPECT_EQ(tick.rotation_target_wxyz, event.rotation_target_wxyz);
    }
  }
  void expect_replays(const Recording& recording) {
    const auto again = replay(recording, loaded_.model);
    ASSERT_TRUE(again.ok()) << again.error().message();
    EXPECT_TRUE(again->identical) << again->difference;
    EXPECT_EQ(again->run_hash, recording.summary->run_hash);
  }

  test::TemporaryFolder folder_;
  LoadedScene loaded_ = testing::loaded_ball();
  std::atomic<bool> stop_{false};
  std::optional<ExploreResult> result_;
};

const char* const kPressAndHold =
    "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nhold = 60.0\n";

TEST_F(ViewedExplore, RemovalIsShownRecordedAndReplayed) {
  loaded_ = testing::loaded_burr();
  ExploreOptions options;
  options.seconds = 60;
  std::vector<SweepRecord> shown;
  bool on = false, softened = false;
  const Recording recording = run(options, kPressAndHold, [&](LiveHost& host, int) {
    std::array<double, kMaxDevices> stiffnesses{};
    const TickRecord tick = host.snapshot(stiffnesses);
    SettingsRequest motor;
    motor.motor = true;
    if (!on && sent_N(tick) > 0.5) {
      EXPECT_EQ(host.state().sweeps, 0u);
      ASSERT_TRUE(host.set(motor).ok());
      EXPECT_TRUE(host.state().motor);
      // the fields of direct methods do not follow the removal
      SettingsRequest direct;
      direct.method = "trilinear";
      EXPECT_EQ(host.set(direct).error().where, "method");
      on = true;
    }
    const std::uint32_t version = host.state().model_version;
    for (const SweepRecord& sweep : host.sweeps(version, shown.size(), 7)) shown.push_back(sweep);
    // a tissue is changed between two cuts
    if (!softened && shown.size() > 10) {
      TissueRequest softer;
      softer.changes[&ContactProperties::stiffness_N_per_mm] = 1.2;
      ASSERT_TRUE(host.set(softer).ok());
      softened = true;
    }
    if (shown.size() > 40) {
      motor.motor = false;
      ASSERT_TRUE(host.set(motor).ok());
      stop_.store(true);
    }
  });
  EXPECT_TRUE(softened);
  const auto changes = changes_in(recording);
  EXPECT_GT(std::ranges::count(changes, ModelChange::kCut, &ModelChange::tissue), 3);
  EXPECT_EQ(std::ranges::count(changes, 0u, &ModelChange::tissue), 1);
  std::size_t sweeps = 0;
  for (const RecordingEvent& event : recording.events) {
    if (event.kind != RecordingEvent::Kind::kSweep) continue;
    if (sweeps < shown.size()) {
      EXPECT_EQ(event.sweep, shown[sweeps]) << sweeps;
    }
    ++sweeps;
  }
  EXPECT_GE(sweeps, shown.size());
  expect_replays(recording);
}

TEST_F(ViewedExplore, UndoDoesNotApplyToAStrokeBegunAfterTheRequest) {
  loaded_ = testing::loaded_burr();
  ExploreOptions options;
  options.seconds = 60;
  enum class At { kBefore, kFirst, kStopped, kSecond, kOver } at = At::kBefore;
  std::chrono::steady_clock::time_point over;
  bool stands = false;
  const auto of_second = [](const SweepRecord& sweep) { return sweep.stroke == 2; };
  run(options, kPressAndHold, [&](LiveHost& host, int) {
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    const TickRecord tick = host.snapshot(stiffness_N_per_mm);
    const ViewedState state = host.state();
    const auto sweeps = host.sweeps(state.model_version, 0, 10000);
    SettingsRequest motor;
    if (at == At::kBefore && sent_N(tick) > 0.5) {
      motor.motor = true;
      at = At::kFirst;
    } else if (at == At::kFirst && sweeps.size() > 20) {
      EXPECT_TRUE(state.motor_is_on);
      motor.motor = false;
      at = At::kStopped;
    } else if (at == At::kStopped && !state.motor_is_on) {
      EXPECT_TRUE(host.set(StrokeRequest{StrokeAction::kUndo, {3, true}, 1}).ok());
      motor.motor = true;
      at = At::kSecond;
    } else if (at == At::kSecond && std::ranges::any_of(sweeps, of_second)) {
      motor.motor = false;
      at = At::kOver;
      over = std::chrono::steady_clock::now();
    } else if (at == At::kOver && std::chrono::steady_clock::now() - over > std::chrono::milliseconds(200)) {
      // by then it would be undone
      stands = std::ranges::any_of(sweeps, of_second);
      stop_.store(true);
    }
    if (motor.motor) {
      ASSERT_TRUE(host.set(motor).ok());
    }
  });
  EXPECT_TRUE(stands);
}

TEST_F(ViewedExplore, StrokeIsUndoneAndRedoneDuringContact) {
  loaded_ = testing::loaded_burr();
  ExploreOptions options;
  options.seconds = 60;
  enum class At { kBefore, kCut, kStopped, kUndone, kDoneAgain } at = At::kBefore;
  std::uint64_t cut = 0;
  double gone_mm3 = 0;
  const ViewerIdentity viewer{3, true};
  const Recording recording = run(options, kPressAndHold, [&](LiveHost& host, int) {
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    const TickRecord tick = host.snapshot(stiffness_N_per_mm);
    const ViewedState state = host.state();
    SettingsRequest motor;
    const StrokeRequest undo{StrokeAction::kUndo, viewer, 1}, redo{StrokeAction::kRedo, viewer, 2};
    if (at == At::kBefore && sent_N(tick) > 0.5) {
      EXPECT_NE(host.set(undo).error().what.find("no stroke"), std::string::npos);
      motor.motor = true;
      ASSERT_TRUE(host.set(motor).ok());
      at = At::kCut;
    } else if (at == At::kCut && state.sweeps > 20) {
      EXPECT_EQ(host.set(undo).error().where, "motor") << "the stroke is not over";
      motor.motor = false;
      ASSERT_TRUE(host.set(motor).ok());
      at = At::kStopped;
    } else if (at == At::kStopped && (tick.switches & kSwitchMotor) == 0) {
      // sweeps of that stroke not yet removed are undone with it
      EXPECT_EQ(state.strokes_to_undo, 1u);
      ASSERT_TRUE(host.set(undo).ok());
      EXPECT_FALSE(host.set(undo).ok()) << "it is wanted already";
      at = At::kUndone;
    } else if (at == At::kUndone && state.strokes_to_redo == 1) {
      EXPECT_EQ(state.sweeps, 0u);
      EXPECT_EQ(state.undone_to, std::vector<std::uint64_t>{0});
      EXPECT_TRUE(state.removed_mm3.empty());
      EXPECT_EQ(host.set(undo).ok(), false);
      ASSERT_TRUE(host.set(redo).ok());
      at = At::kDoneAgain;
    } else if (at == At::kDoneAgain && state.strokes_to_undo == 1) {
      cut = state.sweeps;
      gone_mm3 = state.removed_mm3.at(testing::kBone);
      stop_.store(true);
    }
  });
  EXPECT_GT(cut, 20u);
  EXPECT_GT(gone_mm3, 0.1);
  std::uint64_t sweeps = 0;
  std::vector<std::uint32_t> strokes;
  for (const RecordingEvent& event : recording.events) {
    sweeps += event.kind == RecordingEvent::Kind::kSweep;
    if (event.kind != RecordingEvent::Kind::kModel || !event.change.is_of_stroke()) continue;
    strokes.push_back(event.change.tissue);
    EXPECT_EQ(event.by, (RequestedBy{Originator::kControlViewer, 3}));
  }
  EXPECT_EQ(sweeps, cut);
  EXPECT_EQ(strokes, (std::vector{ModelChange::kUndo, ModelChange::kRedo}));
  expect_replays(recording);
}

TEST_F(ViewedExplore, ViewerChangesAreRecordedAndReplayed) {
  ExploreOptions options;
  options.seconds = 60;
  int changed_at = -1, turned_at = -1;
  double softened_N = 0, reported = 0;
  const Recording recording = run(options, kPressAndHold, [&](LiveHost& host, int call) {
    std::array<double, kMaxDevices> stiffnesses{};
    const TickRecord tick = host.snapshot(stiffnesses);
    if (changed_at < 0 && sent_N(tick) > 0.5) {
      TissueRequest softer;
      softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.9;
      softer.changes[&ContactProperties::static_friction] = 0.6;
      ASSERT_TRUE(host.set(softer).ok());
      softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.8;
      ASSERT_TRUE(host.set(softer).ok());
      SettingsRequest stronger;
      stronger.max_force_N = 2.5;
      ASSERT_TRUE(host.set(stronger).ok());
      changed_at = call;
    }
    // a hand whose thread is delayed bounces on the surface
    if (changed_at >= 0 && turned_at < 0 && call >= changed_at + 25 && sent_N(tick) > 0.1) {
      turned_at = call;
      softened_N = sent_N(tick);
      reported = stiffnesses[0];
      SettingsRequest turn;
      turn.rotation_wxyz = {std::cos(0.05), 0, 0, std::sin(0.05)};
      turn.max_force_N = 1.0;
      ASSERT_TRUE(host.set(turn).ok());
      TissueRequest back;
      back.changes[&ContactProperties::stiffness_N_per_mm] = 1.5;
      ASSERT_TRUE(host.set(back).ok());
      SettingsRequest direct;
      direct.method = "b-spline";
      ASSERT_TRUE(host.set(direct).ok());
    }
    if (turned_at >= 0 && call == turned_at + 25) {
      SettingsRequest paused;
      paused.paused = true;
      ASSERT_TRUE(host.set(paused).ok());
    }
    if (turned_at >= 0 && call == turned_at + 35) stop_.store(true);
  });
  ASSERT_GE(changed_at, 0) << "the ball was never pressed";
  EXPECT_GT(softened_N, 0.1);
  EXPECT_EQ(reported, 0.8);
  EXPECT_EQ(result_->limit_N, 2.5) << "the highest that held";
  const auto changes = changes_in(recording);
  ASSERT_EQ(changes.size(), 3u);
  EXPECT_EQ(changes[1].contact.stiffness_N_per_mm, 0.8);
  EXPECT_EQ(changes[2].contact.static_friction, 0.6);
  expect_events_where_they_took_hold(recording);
  EXPECT_EQ(recording.ticks.back().model_version, 4u);
  EXPECT_EQ(recording.ticks.back().max_force_N, 1.0);
  EXPECT_TRUE(recording.ticks.back().switches & kSwitchPaused);
  EXPECT_NEAR(recording.ticks.back().rotation_target_wxyz[3], std::sin(0.05), 1e-12);
  expect_replays(recording);

  // an interrupted recording contains the changes, too
  Recording cut = recording;
  cut.summary.reset();
  auto again = replay(cut, loaded_.model);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
  // missing changes, and changes that no scene permits, are reported
  Recording without = recording;
  without.events.clear();
  again = replay(without, loaded_.model);
  ASSERT_FALSE(again.ok());
  EXPECT_THAT(again.error().what, HasSubstr("of the model, which is missing from the file"));
  Recording wild = recording;
  first_change(wild).contact.stiffness_N_per_mm = 1e9;
  again = replay(wild, loaded_.model);
  ASSERT_FALSE(again.ok());
  EXPECT_EQ(again.error().where, "stiffness_N_per_mm");
  // and another value gives another run
  Recording other = recording;
  for (RecordingEvent& event : other.events)
    if (event.change.version == 3) event.change.contact.stiffness_N_per_mm = 0.85;
  again = replay(other, loaded_.model);
  ASSERT_TRUE(again.ok());
  EXPECT_FALSE(again->identical);
}

TEST_F(ViewedExplore, RebuiltFieldsReplay) {
  loaded_.model = std::make_shared<const Model>(testing::with_ramps(Model(*loaded_.model), 4));
  ExploreOptions options;
  options.seconds = 60;
  // on a busy machine a direct method occasionally loses contact; the script is repeated
  options.repeat = true;
  int softened_at = -1, contact_at = -1;
  const Recording recording = run(options, kPressAndHold, [&](LiveHost& host, int call) {
    std::array<double, kMaxDevices> stiffnesses{};
    const TickRecord tick = host.snapshot(stiffnesses);
    if (softened_at < 0 && sent_N(tick) > 0.5) {
      TissueRequest softer;
      softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.9;
      ASSERT_TRUE(host.set(softer).ok());
      SettingsRequest direct;
      direct.method = "trilinear";
      ASSERT_TRUE(host.set(direct).ok());
      softened_at = call;
    }
    if (softened_at >= 0 && contact_at < 0 && tick.method == index_of(ForceMethod::kTrilinear))
      contact_at = call;
    // a hand whose thread is delayed bounces on the surface
    if (contact_at >= 0 && call >= contact_at + 30 && stiffnesses[0] != 0) {
      EXPECT_EQ(stiffnesses[0], 0.9);
      stop_.store(true);
    }
  });
  ASSERT_GE(contact_at, 0);
  EXPECT_TRUE(result_->stopped_by_user) << "nothing was felt then";
  const auto changes = changes_in(recording);
  ASSERT_EQ(changes.size(), 2u);
  EXPECT_EQ(changes[1].tissue, ModelChange::kFieldsRebuilt);
  EXPECT_EQ(recording.ticks.back().model_version, 3u);
  expect_replays(recording);
}

TEST_F(ViewedExplore, PointerRecoversAfterConnectionLoss) {
  ExploreOptions options;
  options.devices = {kPointer};
  options.seconds = 30;
  std::string observed;
  enum { kAbove, kPressing, kLost, kBack, kSteady, kDone } part = kAbove;
  int since = 0;
  // the patient's anterior is up: the ball from above, 1 mm deep
  const std::array<double, 3> above{0, -20, 0}, inside{0, -14, 0};
  LiveHost* host = nullptr;
  options.loop.realtime = false;
  options.viewers = [&](LiveHost& session) -> Result<std::shared_ptr<void>> {
    host = &session;
    return std::shared_ptr<void>();
  };
  options.request = [&] {
    if (since == 0) {
      EXPECT_EQ(host->scene().input, "pointer");
      // without control of the pointer nothing moves
      host->move_pointer(PointerTarget{inside});
      EXPECT_TRUE(host->claim_pointer(true, {5, true}).ok());
    }
    ++since;
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    const TickRecord tick = host->snapshot(stiffness_N_per_mm);
    const std::uint32_t flags = tick.device[0].flags;
    observed = "flags " + std::to_string(flags) + ", " + std::to_string(sent_N(tick)) + " N";
    if (part == kAbove) {
      host->move_pointer(PointerTarget{above});
      if ((flags & (kFlagStale | kFlagRamp)) == 0) part = kPressing;
    } else if (part == kPressing) {
      host->move_pointer(PointerTarget{inside});
      if (sent_N(tick) > 0.8) part = kLost;
    } else if (part == kLost) {
      if ((flags & kFlagStale) != 0 && sent_N(tick) == 0) part = kBack;
    } else if (part == kBack) {
      host->move_pointer(PointerTarget{inside});
      if (sent_N(tick) > 0.8) part = kSteady;
    } else if (part == kSteady) {
      // from a point above the surface, in steps of the regulated depth
      host->move_pointer(PointerTarget{{0, -15.5, 0}, {0, 1, 0}, 0.4});
      if (std::abs(sent_N(tick) - 0.4) < 0.02) part = kDone;
    } else {
      EXPECT_TRUE(host->claim_pointer(false, {5, true}).ok());
      if ((flags & kFlagStale) != 0 && sent_N(tick) == 0) stop_.store(true);
    }
    return ExploreRequest::kNone;
  };
  const auto file = folder_ / "run.h5";
  const auto result = explore(loaded_, Script{}, options, file, Progress({}, &stop_));
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_EQ(part, kDone) << observed;
  EXPECT_TRUE(result->stopped_by_user);
  ASSERT_EQ(result->holds.size(), 1u);
  EXPECT_EQ(result->holds[0].structure, "ball");
  const auto recording = read_recording(file);
  ASSERT_TRUE(recording.ok()) << recording.error().message();
  EXPECT_EQ(recording->header.device, "pointer");
  EXPECT_FALSE(recording->header.simulated);
  EXPECT_EQ(recording->header.script_text, "");
  expect_replays(*recording);
  // pointer control and its times: released once, however often it is requested
  ASSERT_EQ(recording->events.size(), 2u);
  for (const RecordingEvent& event : recording->events) {
    EXPECT_EQ(event.kind, RecordingEvent::Kind::kSettings);
    EXPECT_EQ(event.changed, kSettingPointer);
    EXPECT_EQ(event.by, (RequestedBy{Originator::kControlViewer, 5}));
  }
  EXPECT_LT(recording->events[0].tick, recording->events[1].tick);
  // the displayed force has no steps while the pointer is held: 6 mm within an interval of at least 4 ms
  for (std::size_t t = 1; t < recording->ticks.size(); ++t) {
    const TickRecord &now = recording->ticks[t], &before = recording->ticks[t - 1];
    if (((now.device[0].flags | before.device[0].flags) & (kFaultFlags | kFlagStale)) != 0) continue;
    EXPECT_LE(std::abs(sent_N(now) - sent_N(before)), 2000 * now.dt_s + 1e-9) << now.tick;
    EXPECT_EQ(now.device[0].flags & kFlagJump, 0u);
  }
}

TEST_F(ViewedExplore, ViewerServerFailurePreventsTheSession) {
  ExploreOptions options;
  options.viewers = [](LiveHost&) -> Result<std::shared_ptr<void>> {
    return Error{ErrorKind::kUnavailable, "the port is taken", "--port", "choose another"};
  };
  const auto script = parse_script(kPressAndHold, "test script");
  const auto result = explore(loaded_, *script, options, folder_ / "run.h5");
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().where, "--port");
  EXPECT_EQ(folder_.count(), 0u);
}

}  // namespace
}  // namespace palpate
