#include "session/training.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <thread>

#include "base/test_folder.h"
#include "base/test_wait.h"
#include "loading/test_loading.h"
#include "palpate/session/explore.h"
#include "palpate/session/playback.h"

namespace palpate {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::loaded_ball;
using Phase = ViewedTraining::Phase;

constexpr const char* kBallTask = R"(title = "Press the ball"
briefing = "With 0.4 N and more."
quiz = true
end = "END"
[[region]]
name = "ball"
structures = ["ball"]
[[step]]
name = "press"
region = "ball"
force = [0.2, 20]
seconds = 0.2
[[step]]
name = "stroke"
region = "ball"
kind = "cover"
coverage = 0.0005
[[force]]
structures = ["ball"]
band = [0.2, 1.2]
limit = 0.5
[[protected]]
structures = ["ball"]
limit = 0.3
[answer]
structures = ["ball"]
seconds = 0.3
[[metric]]
name = "peak_force"
at_most = 20
[[metric]]
name = "path_length"
[[metric]]
name = "smoothness"
[[metric]]
name = "coverage"
[[metric]]
name = "force_in_band"
[[metric]]
name = "excess_impulse"
[[metric]]
name = "answer_error"
[[metric]]
name = "steps_done"
)";

TaskFile ball_task(const std::string& end) {
  std::string text = kBallTask;
  text.replace(text.find("END"), 3, end);
  auto task = parse_task(text, "ball.toml");
  PALPATE_CHECK(task.ok());
  return *std::move(task);
}

constexpr const char* kTouchAndStroke =
    "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\npress = 0.8\nsettle = 0.1\n[[step]]\nhold = "
    "0.6\n"
    "[[step]]\nslide = 3.0\ndirection = \"left\"\n[[step]]\nleave = true\nspeed = 200.0\n";

void expect_same(const TaskScore& live, const TaskScore& scored) {
  EXPECT_EQ(live.hash, scored.hash);
  EXPECT_EQ(live.ticks, scored.ticks);
  EXPECT_EQ(live.events, scored.events);
  EXPECT_EQ(live.done, scored.done);
  EXPECT_EQ(live.in_band, scored.in_band);
  EXPECT_EQ(live.ended, scored.ended);
  ASSERT_EQ(live.metrics.size(), scored.metrics.size());
  for (std::size_t n = 0; n < live.metrics.size(); ++n) {
    EXPECT_EQ(std::bit_cast<std::uint64_t>(live.metrics[n].value),
              std::bit_cast<std::uint64_t>(scored.metrics[n].value))
        << n;
    EXPECT_EQ(live.metrics[n].in_band, scored.metrics[n].in_band);
  }
}

/// Real-time session with the ball: what it published, and the score of its recording.
class LiveTask : public ::testing::Test {
 protected:
  ExploreResult run(const TrainingOptions& training, const std::function<void(LiveHost&)>& viewer = {}) {
    auto script = parse_script(kTouchAndStroke, "test script");
    PALPATE_CHECK(script.ok());
    ExploreOptions options;
    options.training = training;
    options.loop.ring_s = 30;  // large enough for the whole run
    std::atomic<bool> over{false};
    std::thread watching;
    if (viewer)
      options.viewers = [&](LiveHost& host) -> Result<std::shared_ptr<void>> {
        watching = std::thread([&] { viewer(host); });
        return std::shared_ptr<void>(nullptr, [&](void*) {
          if (watching.joinable()) watching.join();
        });
      };
    auto result = explore(loaded_, *script, options, file_, Progress());
    if (watching.joinable()) watching.join();
    PALPATE_CHECK(result.ok());
    EXPECT_EQ(result->health.dropped, 0u);
    return *std::move(result);
  }
  TaskScore scored(const TaskFile& task, const TickRange& range) {
    constexpr std::array kProxyAlone = {ForceMethod::kProxy};
    const auto model = prepared_with_cache(loaded_.model, kProxyAlone);
    PALPATE_CHECK(model.ok());
    const auto in_scene = resolve_task(task, **model);
    const auto recording = RecordingSource::open(file_);
    PALPATE_CHECK(in_scene.ok() && recording.ok());
    const auto score = score_recording(*in_scene, *recording, {}, range);
    PALPATE_CHECK(score.ok());
    return *score;
  }

  test::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_ / "run.h5";
  LoadedScene loaded_ = loaded_ball();
};

TEST_F(LiveTask, IsTheScoreOfItsRecordingBitForBit) {
  for (const std::string end : {"steps", "recording"}) {
    SCOPED_TRACE(end);
    const TaskFile task = ball_task(end);
    TrainingOptions training;
    training.tasks = {{"ball", task}};
    training.begins_with_first_tick = training.requires_all_tasks = true;
    const ExploreResult result = run(training);
    ASSERT_EQ(result.runs.size(), 1u);
    const TaskRun& live = result.runs[0].run;
    EXPECT_EQ(live.end, end == "steps" ? RunEnd::kTask : RunEnd::kSession);
    EXPECT_EQ(live.task, "ball");
    EXPECT_GT(live.score.events.size(), 2u) << "the limit, what is protected, steps";
    EXPECT_TRUE(live.score.in_band);
    EXPECT_FALSE(std::isnan(live.score.metrics[3].value)) << "coverage";
    expect_same(live.score, scored(task, {}));
    expect_same(live.score, scored(task, live.ticks));
    // a run that ends with its recording has the recording's hash
    if (end == "recording") {
      EXPECT_FALSE(std::isnan(live.score.metrics[6].value)) << "the answer";
      EXPECT_EQ(live.run_hash, result.summary.run_hash);
    }
  }
}

TEST_F(LiveTask, ARunThatEndsWithTheSessionIsDebriefedToItsViewers) {
  TrainingOptions training;
  training.tasks = {{"ball", ball_task("recording")}};
  training.begins_with_first_tick = training.requires_all_tasks = true;
  std::shared_ptr<const ViewedDebriefing> seen;
  std::optional<Error> refused;
  const ExploreResult result = run(training, [&](LiveHost& host) {
    // the viewers' end waits for this
    for (int n = 0; n < 1000 && seen == nullptr; ++n) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      seen = host.debriefing();
    }
    TaskRequest again;
    again.begin = "ball";
    if (const auto begun = host.train(again); !begun) refused = begun.error();
  });
  ASSERT_NE(seen, nullptr);
  EXPECT_EQ(seen->end, "session");
  ASSERT_EQ(result.runs.size(), 1u);
  EXPECT_EQ(result.runs[0].run.end, RunEnd::kSession);
  ASSERT_TRUE(refused);
}

TEST_F(LiveTask, BegunAndEndedMeanwhileIsTheScoreOfItsTicks) {
  const TaskFile task = ball_task("recording");
  TrainingOptions training;
  training.tasks = {{"other", task}, {"ball", task}};
  std::vector<std::string> refusals;
  const auto refusal = [&](const Result<void>& requested) {
    refusals.push_back(requested ? "" : requested.error().message());
  };
  const ExploreResult result = run(training, [&](LiveHost& host) {
    EXPECT_EQ(host.scene().tasks.size(), 2u);
    EXPECT_EQ(host.training().phase, Phase::kNone);
    const auto wait_for = [&](auto&& is) { return testing::soon([&] { return is(host.training()); }); };
    const auto begin = [&](const std::string& name) {
      return testing::soon([&] { return host.train({name, false}).ok(); });
    };
    ASSERT_TRUE(begin("ball"));
    refusal(host.train({"ball", false}));
    refusal(host.train({"nothing", false}));
    ASSERT_TRUE(wait_for([](const ViewedTraining& now) { return now.forces_N.at(0) > 0.3; }));
    ASSERT_TRUE(host.train({{}, true}).ok());
    refusal(host.train({{}, true}));
    ASSERT_TRUE(wait_for([](const ViewedTraining& now) { return now.phase == Phase::kOver; }));
    const auto debriefing = host.debriefing();
    ASSERT_NE(debriefing, nullptr);
    EXPECT_EQ(debriefing->run, 1u);
    EXPECT_EQ(debriefing->end, "asked");
    EXPECT_EQ(debriefing->task, "ball");
    EXPECT_FALSE(debriefing->samples.empty());
    EXPECT_FALSE(debriefing->patches.empty());
    EXPECT_EQ(debriefing->forces, 1u);
    EXPECT_TRUE(debriefing->to_find_mm);
    ASSERT_TRUE(begin("other"));
    EXPECT_EQ(host.debriefing(), nullptr) << "it is another run's";
  });
  ASSERT_EQ(result.runs.size(), 2u);
  EXPECT_THAT(refusals, ElementsAre(HasSubstr("in progress"), HasSubstr("no task with that name"),
                                    HasSubstr("no run is in progress")));
  for (const FinishedRun& finished : result.runs) {
    EXPECT_GT(finished.run.score.ticks, 0u);
    expect_same(finished.run.score, scored(task, finished.run.ticks));
  }
  EXPECT_EQ(result.runs[0].run.end, RunEnd::kRequested);
  EXPECT_EQ(result.runs[1].run.end, RunEnd::kSession);
  EXPECT_LT(result.runs[0].run.ticks.last, result.runs[1].run.ticks.first);
}

TEST_F(LiveTask, PlaybackShowsTheRunAtEveryPosition) {
  const TaskFile task = ball_task("steps");
  TrainingOptions training;
  training.tasks = {{"ball", task}};
  training.begins_with_first_tick = training.requires_all_tasks = true;
  const TaskRun live = run(training).runs.at(0).run;
  const auto opened = [&](const TickRange& ticks) {
    auto recording = RecordingSource::open(file_);
    PALPATE_CHECK(recording.ok());
    return open_playback(*std::move(recording), loaded_.model, Modality::kMr, {},
                         PlayedTaskOptions{{"ball", task}, ticks});
  };
  const auto playback = opened({});
  ASSERT_TRUE(playback.ok()) << playback.error().message();
  PlaybackHost& host = **playback;
  ASSERT_EQ(host.scene().tasks.size(), 1u);
  EXPECT_EQ(host.scene().tasks[0].title, "Press the ball");
  const double begin_s = host.scene().recording->begin_s, end_s = begin_s + live.score.time_s;
  const auto stand_at = [&](double at_s) {
    PlayRequest request;
    request.at_s = at_s;
    ASSERT_TRUE(host.play(request).ok());
    std::array<double, kMaxDevices> unused{};
    ASSERT_TRUE(testing::soon([&] { return std::abs(host.snapshot(unused).time_s - at_s) < 0.002; }));
  };
  // progress at that position
  stand_at(begin_s + 0.5 * live.score.time_s);
  ViewedTraining there = host.training();
  EXPECT_EQ(there.phase, Phase::kRunning);
  EXPECT_EQ(there.task, "ball");
  EXPECT_NEAR(there.time_s, 0.5 * live.score.time_s, 0.06);
  EXPECT_EQ(host.debriefing(), nullptr);
  for (const ViewedTaskEvent& event : there.events) EXPECT_LE(event.time_s, 0.5 * live.score.time_s + 0.002);
  // the debriefing after the run's end, bit for bit
  stand_at(end_s + 0.01);
  there = host.training();
  EXPECT_EQ(there.phase, Phase::kOver);
  EXPECT_THAT(there.done, ::testing::Each(true));
  const auto debriefing = host.debriefing();
  ASSERT_NE(debriefing, nullptr);
  ASSERT_EQ(debriefing->metrics.size(), live.score.metrics.size());
  for (std::size_t n = 0; n < debriefing->metrics.size(); ++n)
    EXPECT_EQ(std::bit_cast<std::uint64_t>(debriefing->metrics[n].value),
              std::bit_cast<std::uint64_t>(live.score.metrics[n].value));
  EXPECT_EQ(debriefing->end, "task");
  EXPECT_EQ(debriefing->last_tick, live.ticks.last);
  // and backwards again
  stand_at(begin_s + 0.1);
  EXPECT_EQ(host.training().phase, Phase::kRunning);
  EXPECT_EQ(host.debriefing(), nullptr);
  // no run before its beginning
  const auto later = opened({live.ticks.first + 200, live.ticks.last});
  ASSERT_TRUE(later.ok());
  EXPECT_EQ((*later)->training().phase, Phase::kNone);
  EXPECT_THAT(opened({1'000'000'000, 1'000'000'001}).error().what, HasSubstr("none of the selected ticks"));
}

TEST_F(LiveTask, ATaskThatDoesNotFitIsLeftOutOrRefused) {
  TaskFile other = ball_task("steps");
  other.regions[0].structures = {std::string("heart")};
  const auto model = loaded_.model;
  TrainingOptions training;
  training.tasks = {{"heart", other}, {"ball", ball_task("steps")}};
  const auto left_out = Training::start(training, *model, 1, {});
  ASSERT_TRUE(left_out.ok());
  ASSERT_EQ((*left_out)->tasks().size(), 1u);
  EXPECT_EQ((*left_out)->tasks()[0].name, "ball");
  training.requires_all_tasks = true;
  const auto refused = Training::start(training, *model, 1, {});
  ASSERT_FALSE(refused.ok());
  EXPECT_THAT(refused.error().message(), HasSubstr("heart"));
}

/// Training fed with synthetic ticks.
class HandMade : public ::testing::Test {
 protected:
  std::unique_ptr<Training> training(TrainingOptions options = {}, const std::string& end = "recording") {
    options.tasks = {{"ball", ball_task(end)}};
    auto started = Training::start(options, *loaded_ball().model, 1, {});
    PALPATE_CHECK(started.ok());
    (*started)->begin_session({});
    return *std::move(started);
  }
  static TickRecord tick(std::uint64_t n, double force_N) {
    TickRecord tick;
    tick.tick = n;
    tick.time_s = static_cast<double>(n) / 1000;
    tick.device[0].tip_patient_mm = {static_cast<double>(n) / 100, 0, 0};
    tick.device[0].normal_patient = {0, 0, 1};
    tick.device[0].contact_label[0] = force_N > 0 ? testing::kBone : LabelId{0};
    tick.device[0].contact_N[0] = force_N;
    tick.device[0].force_N = {0, 0, 1.1 * force_N};  // with friction
    return tick;
  }
  static void wait_until_stored(const Training& training) {
    ASSERT_TRUE(testing::soon([&] { return training.state().phase == Phase::kOver; }));
  }
};

TEST_F(HandMade, PublishesProgress) {
  const auto training = this->training();
  EXPECT_EQ(training->state().run, 0u);
  training->observe(tick(0, 0));
  ASSERT_TRUE(training->begin("ball").ok());
  for (std::uint64_t n = 100; n < 200; ++n) training->observe(tick(n, 0.4));
  ViewedTraining now = training->state();
  EXPECT_EQ(now.phase, Phase::kRunning);
  EXPECT_EQ(now.task, "ball");
  EXPECT_NEAR(now.time_s, 0.099, 1e-9);
  EXPECT_THAT(now.forces_N, ElementsAre(0.4));
  EXPECT_THAT(now.protected_N, ElementsAre(0.4));
  EXPECT_EQ(now.touch_N, 0.4);
  EXPECT_NEAR(now.fraction[0], 0.099 / 0.2, 1e-9);
  ASSERT_EQ(now.events.size(), 1u) << "what is protected was touched";
  EXPECT_STREQ(now.events[0].kind, "protected");
  for (std::uint64_t n = 200; n < 400; ++n) training->observe(tick(n, n % 2 ? 0.6 : 0.4));
  now = training->state();
  EXPECT_TRUE(now.done[0]);
  EXPECT_EQ(now.events.size(), ViewedTraining::kMaxEvents) << "the last ones";
  EXPECT_GT(now.events_before, 80u);
  EXPECT_EQ(now.missing_s, 0);
}

TEST_F(HandMade, DroppedTicksAreReportedAndFailTheRun) {
  for (const bool drops : {false, true}) {
    const auto training = this->training();
    ASSERT_TRUE(training->begin("ball").ok());
    for (std::uint64_t n = 0; n < 500; ++n)
      if (!(drops && n == 300)) training->observe(tick(n, 0.4));
    EXPECT_NEAR(training->state().missing_s, drops ? 0.002 : 0, 1e-9);
    ASSERT_TRUE(training->end_run().ok());
    wait_until_stored(*training);
    EXPECT_EQ(training->finished()[0].run.score.in_band, !drops);
    EXPECT_EQ(training->debriefing()->in_band, !drops);
    EXPECT_NEAR(training->debriefing()->missing_s, drops ? 0.002 : 0, 1e-9);
  }
}

TEST_F(HandMade, BackwardClockEndsTheRun) {
  const auto training = this->training();
  ASSERT_TRUE(training->begin("ball").ok());
  for (const std::uint64_t n : {5u, 6u, 3u, 7u}) training->observe(tick(n, 0.4));
  wait_until_stored(*training);
  EXPECT_EQ(training->finished()[0].run.end, RunEnd::kFailure);
  EXPECT_FALSE(training->finished()[0].run.score.in_band);
  EXPECT_EQ(training->finished()[0].run.ticks.last, 6u);
}

TEST_F(HandMade, LongTraceKeepsPeaksInFewSamples) {
  const auto training = this->training();
  ASSERT_TRUE(training->begin("ball").ok());
  // 40 s at 1 kHz with a peak of one tick each second and one in the very last tick
  for (std::uint64_t n = 0; n < 40001; ++n)
    training->observe(tick(n, n % 1000 == 500 || n == 40000 ? 0.9 : 0.3));
  ASSERT_TRUE(training->end_run().ok());
  wait_until_stored(*training);
  const auto debriefing = training->debriefing();
  const auto& samples = debriefing->samples;
  EXPECT_LE(samples.size(), RunTrace::kMaxSamples + 1);
  EXPECT_GE(samples.size(), RunTrace::kMaxSamples / 2);
  int peaks = 0;
  for (std::size_t n = 0; n < samples.size(); ++n) {
    peaks += samples[n].touch_N == 0.9;
    EXPECT_EQ(samples[n].forces_N[0], samples[n].touch_N);
    EXPECT_NEAR(samples[n].tip_mm[0], 10 * samples[n].time_s, 1e-6);
    if (n > 0) {
      EXPECT_GT(samples[n].time_s, samples[n - 1].time_s);
    }
  }
  EXPECT_EQ(peaks, 41);
  EXPECT_NEAR(samples.back().time_s, debriefing->time_s, 1e-9);
}

TEST_F(HandMade, HistoryComesFromTheSessionOrTheRecords) {
  TrainingOptions options;
  std::vector<std::uint32_t> stored;
  std::atomic<bool> may_proceed{true};
  options.learner = "L042";
  options.store_run = [&](const TaskFile& task, const TaskRun& run) {
    while (!may_proceed.load()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    stored.push_back(run.number);
    RunHistory history;
    // the second run could not be stored
    if (run.number == 2) {
      history.not_stored = Error{ErrorKind::kUnavailable, "the disk is full", "", ""};
      return history;
    }
    history.runs = 7;
    history.run_id = 41;
    history.best.assign(task.metrics.size(), 0.5);
    return history;
  };
  const auto training = this->training(options);
  std::uint64_t n = 0;
  const auto do_run = [&](double force_N) {
    ASSERT_TRUE(training->begin("ball").ok());
    for (const std::uint64_t end = n + 400; n < end; ++n) training->observe(tick(n, force_N));
    ASSERT_TRUE(training->end_run().ok());
  };
  may_proceed = false;
  do_run(0.4);
  EXPECT_EQ(training->state().phase, Phase::kStoring);
  EXPECT_THAT(training->begin("ball").error().message(), HasSubstr("still being stored"));
  may_proceed = true;
  wait_until_stored(*training);
  EXPECT_EQ(training->debriefing()->runs, 7);
  EXPECT_EQ(training->debriefing()->run_id, 41);
  EXPECT_EQ(training->debriefing()->metrics[0].best, 0.5);
  do_run(0.3);
  wait_until_stored(*training);
  EXPECT_EQ(training->debriefing()->runs, 2);
  EXPECT_EQ(training->debriefing()->in_a_row, 2);
  EXPECT_EQ(training->debriefing()->metrics[0].best, 0.4) << "the peak of the run before";
  EXPECT_EQ(training->debriefing()->metrics[0].value, 0.3);
  EXPECT_TRUE(training->debriefing()->not_stored);
  // a run without ticks does not count
  ASSERT_TRUE(training->begin("ball").ok());
  ASSERT_TRUE(training->end_run().ok());
  wait_until_stored(*training);
  EXPECT_FALSE(training->debriefing()->in_band);
  training->end();
  EXPECT_EQ(stored, (std::vector<std::uint32_t>{1, 2}));
  EXPECT_FALSE(training->begin("ball").ok());
}

TEST_F(HandMade, RunsAreAttributedToTheirInitiator) {
  TrainingOptions options;
  std::vector<std::string> stored;
  options.store_run = [&](const TaskFile&, const TaskRun& run) {
    stored.push_back(run.learner);
    return RunHistory{};
  };
  const auto training = this->training(options);
  std::uint64_t n = 0;
  const auto do_run = [&](const std::string& learner) {
    ASSERT_TRUE(training->begin("ball", learner).ok());
    for (const std::uint64_t end = n + 400; n < end; ++n) training->observe(tick(n, 0.4));
    EXPECT_FALSE(training->teach({.learner = "L043"}).ok()) << "not in the middle of a run";
    ASSERT_TRUE(training->end_run().ok());
    wait_until_stored(*training);
  };
  // a run without a learner is not stored, and every learner has a separate history
  do_run("");
  EXPECT_FALSE(training->debriefing()->run_id);
  EXPECT_FALSE(training->state().is_stored);
  do_run("L007");
  EXPECT_EQ(training->debriefing()->learner, "L007");
  do_run("L042");
  EXPECT_EQ(training->debriefing()->runs, 1);
  do_run("L007");
  EXPECT_EQ(training->debriefing()->runs, 2);
  // a teacher chooses the learner of runs that are begun without a name
  ASSERT_TRUE(training->teach({.learner = "L042"}).ok());
  EXPECT_TRUE(training->state().is_stored);
  EXPECT_EQ(training->lesson().learner, "L042");
  do_run("");
  ASSERT_TRUE(training->teach({.learner = ""}).ok());
  do_run("");
  EXPECT_EQ(stored, (std::vector<std::string>{"L007", "L042", "L007", "L042"}));
  // and the task that may be begun
  EXPECT_EQ(training->teach({.task = "none"}).error().where, "task");
  EXPECT_EQ(training->teach({.learner = "two\nlines"}).error().kind, ErrorKind::kBadInput);
  ASSERT_TRUE(training->teach({.task = "ball"}).ok());
  EXPECT_TRUE(training->begin("ball").ok());
}

TEST_F(HandMade, ARunIsStoredOnlyIfItsLearnerAloneHeldTheTip) {
  TrainingOptions options;
  options.learner = "L042";
  std::vector<std::uint32_t> stored;
  options.store_run = [&](const TaskFile& task, const TaskRun& run) {
    stored.push_back(run.number);
    RunHistory history;
    history.runs = 1;
    history.run_id = 7;
    history.best.assign(task.metrics.size(), kNoValue);
    return history;
  };
  const auto training = this->training(options);
  std::uint64_t n = 0;
  const auto see_some = [&] {
    for (const std::uint64_t end = n + 50; n < end; ++n) training->observe(tick(n, 0.4));
  };
  using Holders = std::vector<std::optional<ViewerIdentity>>;
  // the holders of a run one after the other, of which the first one had the tip before it began
  const auto refusal_of = [&](const Holders& holders) {
    for (std::size_t h = 0; h < holders.size(); ++h) {
      training->set_tip_holder(holders[h]);
      if (h == 0) {
        EXPECT_TRUE(training->begin("ball").ok());
      }
      see_some();
    }
    EXPECT_TRUE(training->end_run().ok());
    wait_until_stored(*training);
    const RunHistory history = training->finished().back().history;
    EXPECT_EQ(history.run_id.has_value(), !history.not_stored);
    return history.not_stored ? history.not_stored->what : std::string();
  };
  const ViewerIdentity own{1, true, "L042"}, other{2, true, "L007"}, teacher{3, true, "", true},
      at_the_desk{4, true};
  EXPECT_THAT(refusal_of({std::nullopt}), HasSubstr("no viewer moved the tip"));
  EXPECT_THAT(refusal_of({std::nullopt, teacher}), HasSubstr("another viewer moved the tip during the run"));
  EXPECT_THAT(refusal_of({other}), HasSubstr("another viewer moved the tip during the run"));
  EXPECT_THAT(refusal_of({own, teacher, own}), HasSubstr("part of the run"));
  EXPECT_TRUE(stored.empty());
  EXPECT_EQ(refusal_of({own}), "");
  EXPECT_EQ(refusal_of({std::nullopt, own, std::nullopt}), "");
  EXPECT_EQ(refusal_of({at_the_desk}), "") << "who has no token of a learner acts for the session's";
  EXPECT_EQ(stored.size(), 3u);
  // a session whose tip no viewer moves stores every run
  const auto guided_by_device = this->training(options);
  EXPECT_TRUE(guided_by_device->begin("ball").ok());
  guided_by_device->observe(tick(0, 0.4));
  EXPECT_TRUE(guided_by_device->end_run().ok());
  wait_until_stored(*guided_by_device);
  EXPECT_EQ(stored.size(), 4u);
}

TEST_F(HandMade, AKeyBeginsAndEnds) {
  const auto training = this->training();
  ASSERT_TRUE(training->begin_or_end().ok());
  training->observe(tick(1, 0.4));
  EXPECT_EQ(training->state().phase, Phase::kRunning);
  ASSERT_TRUE(training->begin_or_end().ok());
  wait_until_stored(*training);
  EXPECT_EQ(training->finished()[0].run.end, RunEnd::kRequested);
}

// ---- a scope on a second device

TaskFile scope_task() {
  auto task = parse_task(R"(title = "Watch"
[scope]
optics = 0
back = 5
[[region]]
name = "ball"
structures = ["ball"]
[[step]]
name = "press"
region = "ball"
seconds = 0.2
seen = true
[[metric]]
name = "unseen_time"
)",
                         "watch.toml");
  PALPATE_CHECK(task.ok());
  return *std::move(task);
}

TEST(ScopeTask, IsOfferedWhereASecondDeviceHoldsTheScope) {
  const auto model = loaded_ball().model;
  TrainingOptions options;
  options.tasks = {{"watch", scope_task()}, {"ball", ball_task("steps")}};
  const auto alone = Training::start(options, *model, 1, {});
  ASSERT_TRUE(alone.ok());
  ASSERT_EQ((*alone)->tasks().size(), 1u);
  const auto both = Training::start(options, *model, 2, {});
  ASSERT_TRUE(both.ok());
  ASSERT_EQ((*both)->tasks().size(), 2u);
  EXPECT_EQ((*both)->tasks()[0].scope->optics_deg, 0);
  EXPECT_EQ((*both)->tasks()[0].scope->back_mm, 5);
  EXPECT_TRUE((*both)->tasks()[0].steps[0].in_scope_view);
  options.requires_all_tasks = true;
  const auto refused = Training::start(options, *model, 1, {});
  ASSERT_FALSE(refused.ok());
  EXPECT_THAT(refused.error().message(),
              HasSubstr("watch.toml:2: the task needs a second device for the scope"));
}

TEST(ScopeTask, ReportsContactOutsideTheView) {
  TrainingOptions options;
  options.tasks = {{"watch", scope_task()}};
  const auto training = Training::start(options, *loaded_ball().model, 2, {});
  ASSERT_TRUE(training.ok());
  (*training)->begin_session({});
  ASSERT_TRUE((*training)->begin("watch").ok());
  std::uint64_t n = 0;
  const auto touch_for = [&](int ticks, double z_mm) {
    for (int i = 0; i < ticks; ++i) {
      TickRecord tick;
      tick.tick = n;
      tick.time_s = static_cast<double>(n++) / 1000;
      tick.devices = 2;
      tick.device[0].contact_label[0] = testing::kBone;
      tick.device[0].contact_N[0] = 0.5;
      tick.device[0].force_N = {0, 0, 0.5};
      tick.device[0].contact_patient_mm = {0, z_mm, 0};
      // World's z is anterior: the scope looks posterior, at the ball's front
      tick.device[1].tip_patient_mm = {0, -40, 0};
      (*training)->observe(tick);
    }
  };
  touch_for(100, 15);
  EXPECT_TRUE((*training)->state().unseen) << "on its back";
  ASSERT_EQ((*training)->state().events.size(), 1u);
  EXPECT_STREQ((*training)->state().events[0].kind, "unseen");
  EXPECT_EQ((*training)->state().fraction[0], 0);
  touch_for(100, -15);
  EXPECT_FALSE((*training)->state().unseen);
  EXPECT_NEAR((*training)->state().fraction[0], 0.5, 0.01);
  touch_for(150, -15);
  ASSERT_TRUE(testing::soon([&] { return (*training)->state().phase == Phase::kOver; }));
  EXPECT_NEAR((*training)->finished()[0].run.score.metrics[0].value, 0.0995, 1e-9);
}

// ---- material removal

class TakeOffLive : public ::testing::Test {
 protected:
  void SetUp() override {
    test::write_text(folder_ / "plan.toml",
                     "title = \"Ball\"\n[[region]]\nname = \"all of it\"\nstructures = [\"ball\"]\n");
    test::write_text(
        folder_ / "task.toml",
        "title = \"Take off\"\nend = \"recording\"\nplan = \"plan.toml\"\n"
        "[[region]]\nname = \"ball\"\nstructures = [\"ball\"]\n"
        "[[step]]\nname = \"a hundredth\"\nkind = \"remove\"\nregion = \"all of it\"\ncoverage = "
        "0.01\n[[metric]]\nname = \"removed_in_plan\"\n");
    auto task = load_task((folder_ / "task.toml").string());
    PALPATE_CHECK(task.ok());
    TrainingOptions options;
    options.tasks = {{"take-off", *std::move(task)}};
    auto started = Training::start(options, *testing::loaded_burr().model, 1, {});
    PALPATE_CHECK(started.ok());
    training_ = *std::move(started);
    training_->begin_session({});
  }
  void ticks(int count, const std::vector<RecordingEvent>& events = {}) {
    for (int i = 0; i < count; ++i) {
      TickRecord tick;
      tick.tick = n_;
      tick.time_s = static_cast<double>(n_++) / 1000;
      training_->observe(tick, i == 0 ? std::span(events) : std::span<const RecordingEvent>());
    }
  }
  std::vector<RecordingEvent> cut() {
    RecordingEvent sweep;
    sweep.kind = RecordingEvent::Kind::kSweep;
    sweep.sweep.radius_mm = 4;
    return {sweep, change(ModelChange::kCut)};
  }
  RecordingEvent change(std::uint32_t kind) {
    RecordingEvent event;
    event.number = event.change.version = ++version_;
    event.change.tissue = kind;
    return event;
  }
  double volume_of(std::size_t run) const { return training_->finished()[run].run.score.metrics[0].value; }
  void end() {
    ASSERT_TRUE(training_->end_run().ok());
    ASSERT_TRUE(testing::soon([&] { return training_->state().phase == Phase::kOver; }));
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<Training> training_;
  std::uint64_t n_ = 0;
  std::uint32_t version_ = 1;
};

TEST_F(TakeOffLive, PublishesProgressAndCountsRemoval) {
  ASSERT_EQ(training_->tasks()[0].regions.size(), 2u) << "the plan's come after the task's";
  EXPECT_EQ(training_->tasks()[0].regions[1].name, "all of it");
  EXPECT_GT(training_->tasks()[0].regions[1].radius_mm, 14);
  EXPECT_EQ(training_->tasks()[0].steps[0].region, 1u);
  EXPECT_EQ(training_->tasks()[0].steps[0].kind, "remove");
  ASSERT_TRUE(training_->begin("take-off").ok());
  ticks(100);
  EXPECT_EQ(training_->state().fraction[0], 0);
  ticks(150, cut());
  EXPECT_TRUE(training_->state().done[0]);
  end();
  EXPECT_NEAR(volume_of(0), 268, 5);

  // material removed before a run begins would be attributed to that run
  EXPECT_THAT(training_->begin("take-off").error().message(), HasSubstr("tissue has already been removed"));
  ticks(10, {change(ModelChange::kUndo)});
  ASSERT_TRUE(training_->begin("take-off").ok());
  ticks(10);
  EXPECT_FALSE(training_->state().done[0]);
  ticks(10, {change(ModelChange::kRedo)});
  end();
  EXPECT_EQ(volume_of(1), volume_of(0)) << "strokes from before can be done again";
}

TEST(ViewedTask, HasStepsAndRegions) {
  TrainingOptions options;
  options.tasks = {{"ball", ball_task("steps")}};
  const auto training = Training::start(options, *loaded_ball().model, 1, {});
  ASSERT_TRUE(training.ok());
  const ViewedTask& task = (*training)->tasks()[0];
  EXPECT_EQ(task.title, "Press the ball");
  EXPECT_TRUE(task.quiz);
  EXPECT_TRUE(task.ends_with_steps);
  ASSERT_EQ(task.steps.size(), 2u);
  EXPECT_EQ(task.steps[1].kind, "cover");
  EXPECT_THAT(task.forces[0].labels, ElementsAre(testing::kBone));
  EXPECT_THAT(task.to_find, ElementsAre(testing::kBone));
  EXPECT_EQ(task.answer_s, 0.3);
  ASSERT_EQ(task.regions.size(), 1u);
  // all of the ball is exposed: no viewing direction is preferred
  EXPECT_EQ(task.regions[0].outward, (std::array<double, 3>{0, 0, 0}));
  EXPECT_GT(task.regions[0].radius_mm, 5);
  ASSERT_TRUE(task.regions[0].extent.has_value());
  EXPECT_THAT(task.regions[0].extent->labels, ElementsAre(testing::kBone));
  EXPECT_EQ(task.metrics[0].name, "peak_force");
  EXPECT_EQ(task.metrics[0].unit, "N");
  EXPECT_EQ(task.metrics[0].at_most, 20);
  EXPECT_EQ(task.metrics[0].basis, "");
}

}  // namespace
}  // namespace palpate
