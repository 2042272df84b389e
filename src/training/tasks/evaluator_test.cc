#include "palpate/tasks/evaluator.h"
#include "palpate/recording/recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <fstream>
#include <numbers>

#include "base/test_folder.h"
#include "loading/test_loading.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

constexpr std::array kRates_Hz{1000.0, 4000.0, 10000.0};
constexpr LabelId kMeniscus = 3, kNerve = 7;

constexpr const char* kTask = R"(title = "Test"
end = "recording"
[[region]]
name = "meniscus"
structures = [3]
[[region]]
name = "end"
point = [100, 0, 0]
radius = 5
[[step]]
name = "push"
region = "meniscus"
force = [2, 3.6]
seconds = 0.5
[[step]]
name = "arrive"
region = "end"
kind = "visit"
[[force]]
structures = [3]
band = [1, 3]
limit = 8.5
[[protected]]
structures = [7]
limit = 0.5
[[metric]]
name = "time"
[[metric]]
name = "path_length"
[[metric]]
name = "economy"
[[metric]]
name = "mean_force"
structures = [3]
[[metric]]
name = "peak_force"
structures = [3]
at_most = 8.5
[[metric]]
name = "force_in_band"
[[metric]]
name = "longest_in_band"
[[metric]]
name = "excess_impulse"
[[metric]]
name = "protected_time"
[[metric]]
name = "steps_done"
[[metric]]
name = "smoothness"
[[metric]]
name = "idle_time"
)";

Model model_of_labels() {
  GridGeometry grid;
  grid.dims = {4, 4, 4};
  Volume<LabelId> labels(grid, 0);
  labels.at(1, 1, 1) = kMeniscus;
  labels.at(2, 2, 2) = kNerve;
  Model model;
  model.labels = label_bricks(labels);
  model.segments = {{kMeniscus, "medial_meniscus", {}, 0, kMeniscus}, {kNerve, "nerve", {}, 0, kNerve}};
  return model;
}

TaskInScene in_scene(const std::string& text) {
  const auto task = parse_task(text, "task.toml");
  PALPATE_CHECK(task.ok());
  auto found = resolve_task(*task, model_of_labels());
  PALPATE_CHECK(found.ok());
  return *std::move(found);
}

TickRecord tick_at(std::uint64_t n, double rate_hz) {
  TickRecord tick;
  tick.tick = n;
  tick.time_s = static_cast<double>(n) / rate_hz;
  tick.dt_s = 1 / rate_hz;
  tick.state_hash = n * 77;
  return tick;
}

/// A contact whose force is sent in full, with friction.
void touch(DeviceTick& device, std::size_t n, LabelId label, double force_N) {
  device.force_N[2] += 1.1 * force_N;
  device.contact_label[n] = label;
  device.contact_N[n] = force_N;
  device.normal_patient = {0, 0, 1};
}

/// A run of 20 s: a straight path of 100 mm in 10 s, then a force that varies sinusoidally, 0 ... 10 N at
/// 0.25 Hz.
template <class Take>
void synthetic_run(double rate_hz, const Take& take) {
  const auto count = static_cast<std::uint64_t>(std::llround(20 * rate_hz));
  for (std::uint64_t n = 0; n <= count; ++n) {
    TickRecord tick = tick_at(n, rate_hz);
    const double t = tick.time_s;
    const double s = std::min(t / 10, 1.0);
    tick.device[0].tip_patient_mm = {100 * s * s * s * (10 - 15 * s + 6 * s * s), 0, 0};
    if (t > 10)
      touch(tick.device[0], 0, kMeniscus, 10 * std::pow(std::sin(std::numbers::pi * (t - 10) / 10), 2));
    if (t > 12 && t < 13) touch(tick.device[0], 1, kNerve, 1);
    take(tick);
  }
}

double value(const TaskScore& score, Metric metric) {
  for (const MetricValue& value : score.metrics)
    if (value.metric == metric) return value.value;
  return kNoValue;
}

TEST(Evaluator, GivesClosedFormsAtEveryRate) {
  // F = 10 sin^2(pi u / 10), u = 0 ... 10 s: mean 5; above L for a fraction 1 - 2 asin(sqrt(L / 10)) / pi of
  // the time
  const auto part_above = [](double limit) {
    return 1 - 2 * std::asin(std::sqrt(limit / 10)) / std::numbers::pi;
  };
  // integral of 10 sin^2 - L above L: 5 w - L w + (25 / pi) sin(pi w / 5 ...), in closed form over the
  // crossing times
  const double a = 10 / std::numbers::pi * std::asin(std::sqrt(0.85));
  const auto primitive = [](double u) {
    return 5 * u - 25 / std::numbers::pi * std::sin(std::numbers::pi * u / 5) - 8.5 * u;
  };
  const double excess = primitive(10 - a) - primitive(a);
  for (const double rate_hz : kRates_Hz) {
    TaskEvaluator evaluator(in_scene(kTask));
    synthetic_run(rate_hz, [&](const TickRecord& tick) { ASSERT_TRUE(evaluator.observe(tick).ok()); });
    const TaskScore score = evaluator.score(false);
    EXPECT_NEAR(value(score, Metric::kTime), 20, 1e-9);
    EXPECT_NEAR(value(score, Metric::kPathLength), 100, 0.1);
    EXPECT_NEAR(value(score, Metric::kEconomy), 1, 1e-3);
    EXPECT_NEAR(value(score, Metric::kMeanForce), 5, 0.005);
    EXPECT_NEAR(value(score, Metric::kPeakForce), 10, 0.01);
    EXPECT_NEAR(value(score, Metric::kForceInBand) / (part_above(1) - part_above(3)), 1, 1e-3);
    EXPECT_NEAR(value(score, Metric::kLongestInBand) / (5 * (part_above(1) - part_above(3))), 1, 1e-3);
    EXPECT_NEAR(value(score, Metric::kExcessImpulse) / excess, 1, 1e-3);
    EXPECT_NEAR(value(score, Metric::kProtectedTime), 1, 1.001 / rate_hz);  // to within a tick
    EXPECT_EQ(value(score, Metric::kStepsDone), 1);
    EXPECT_FALSE(score.in_band);  // 10 N
    EXPECT_EQ(score.missing_s, 0);
  }
}

TEST(Evaluator, FlagsTheVeryTickThatPassesALimit) {
  for (const double rate_hz : kRates_Hz) {
    TaskEvaluator evaluator(in_scene(kTask));
    std::uint64_t first = 0;
    synthetic_run(rate_hz, [&](const TickRecord& tick) {
      if (first == 0 && tick.device[0].contact_N[0] > 8.5) first = tick.tick;
      ASSERT_TRUE(evaluator.observe(tick).ok());
    });
    const TaskScore score = evaluator.score(false);
    std::vector<TaskEvent> over;
    for (const TaskEvent& event : score.events)
      if (event.kind == TaskEvent::Kind::kOverLimit) over.push_back(event);
    ASSERT_EQ(over.size(), 1u);
    EXPECT_EQ(over[0].tick, first);
    EXPECT_GT(over[0].force_N, 8.5);
    EXPECT_THAT(event_text(evaluator.task().file, over[0]), HasSubstr("above 8.5 N"));
  }
}

TEST(Evaluator, ASingleTickAboveALimitIsFlagged) {
  TaskEvaluator evaluator(in_scene(kTask));
  for (std::uint64_t n = 0; n < 10; ++n) {
    TickRecord tick = tick_at(n, 1000);
    touch(tick.device[0], 0, kMeniscus, n == 4 ? 8.5000001 : 8.5);
    ASSERT_TRUE(evaluator.observe(tick).ok());
  }
  const TaskScore score = evaluator.score(false);
  ASSERT_EQ(score.events.size(), 1u);
  EXPECT_EQ(score.events[0].tick, 4u);
}

TEST(Evaluator, IsTheSameBitForBitFromARecording) {
  const test::TemporaryFolder folder;
  for (const double rate_hz : kRates_Hz) {
    TaskEvaluator live(in_scene(kTask));
    RecordingHeader header;
    header.rate_hz = rate_hz;
    const auto file = folder / "run.h5";
    auto writer = RecordingWriter::create(file, header);
    ASSERT_TRUE(writer.ok());
    RecordingSummary summary;
    synthetic_run(rate_hz, [&](const TickRecord& tick) {
      ASSERT_TRUE(live.observe(tick).ok());
      ASSERT_TRUE((*writer)->append({&tick, 1}).ok());
      summary.observe(tick);
    });
    ASSERT_TRUE((*writer)->finish(summary).ok());
    const auto source = RecordingSource::open(file);
    ASSERT_TRUE(source.ok());
    const auto again = score_recording(in_scene(kTask), *source);
    ASSERT_TRUE(again.ok()) << again.error().message();
    const TaskScore score = live.score(false);
    EXPECT_EQ(again->hash, score.hash);
    EXPECT_EQ(again->events, score.events);
    for (std::size_t n = 0; n < score.metrics.size(); ++n)
      EXPECT_EQ(std::bit_cast<std::uint64_t>(again->metrics[n].value),
                std::bit_cast<std::uint64_t>(score.metrics[n].value));
  }
}

TEST(Evaluator, IsTheSameWithinAHundredthAtEveryRate) {
  std::vector<TaskScore> scores;
  for (const double rate_hz : kRates_Hz) {
    TaskEvaluator evaluator(in_scene(kTask));
    // tremor of 0.1 mm at 9 Hz
    synthetic_run(rate_hz, [&](TickRecord tick) {
      tick.device[0].tip_patient_mm[1] += 0.1 * std::sin(2 * std::numbers::pi * 9 * tick.time_s);
      ASSERT_TRUE(evaluator.observe(tick).ok());
    });
    scores.push_back(evaluator.score(false));
  }
  for (std::size_t n = 0; n < scores[0].metrics.size(); ++n) {
    for (const TaskScore& score : scores)
      EXPECT_NEAR(score.metrics[n].value, scores[2].metrics[n].value,
                  0.01 * std::abs(scores[2].metrics[n].value) + 1e-9)
          << info_of(score.metrics[n].metric).name;
  }
}

TEST(Evaluator, AttributesForcesBeneathToTheTouchedStructure) {
  TaskEvaluator evaluator(in_scene(kTask));
  for (std::uint64_t n = 0; n < 100; ++n) {
    TickRecord tick = tick_at(n, 1000);
    touch(tick.device[0], 0, kMeniscus, 2);
    touch(tick.device[0], 1, 9, 1.5);
    tick.device[0].contact_patient_mm = {1, 1, 1, 0, 0, -4};  // beneath; the normal is z
    touch(tick.device[0], 2, 10, 4);
    tick.device[0].contact_patient_mm[6] = 5;  // next to it
    tick.device[0].contact_patient_mm[8] = 1;
    ASSERT_TRUE(evaluator.observe(tick).ok());
  }
  EXPECT_NEAR(value(evaluator.score(false), Metric::kPeakForce), 3.5, 1e-12);
}

TEST(Evaluator, AForceCountsAsItWasSent) {
  // limited, in devices of different gain, withheld, and not a number
  struct Case {
    double sent_N, gain, expected_N;
  };
  for (const Case& c :
       {Case{3, 1, 3}, Case{100, 1, 6}, Case{100, 0.5, 3}, Case{1.5, 0.5, 1.5}, Case{3, 2, 3}}) {
    TaskEvaluator evaluator(in_scene(kTask));
    for (std::uint64_t n = 0; n < 10; ++n) {
      TickRecord tick = tick_at(n, 1000);
      touch(tick.device[0], 0, kMeniscus, 6);
      tick.device[0].force_N = {0, 0.6 * c.sent_N, -0.8 * c.sent_N};
      tick.device[0].force_gain = c.gain;
      ASSERT_TRUE(evaluator.observe(tick).ok());
    }
    EXPECT_NEAR(value(evaluator.score(false), Metric::kPeakForce), c.expected_N, 1e-9);
    EXPECT_LE(value(evaluator.score(false), Metric::kPeakForce), c.sent_N);
  }
  for (const double sent_N : {0.0, kNoValue}) {
    TaskEvaluator evaluator(in_scene(kTask));
    for (std::uint64_t n = 0; n < 1000; ++n) {
      TickRecord tick = tick_at(n, 1000);
      touch(tick.device[0], 0, kMeniscus, 3);
      tick.device[0].force_N = {0, 0, sent_N};
      ASSERT_TRUE(evaluator.observe(tick).ok());
    }
    EXPECT_TRUE(std::isnan(value(evaluator.score(false), Metric::kPeakForce)));
    EXPECT_FALSE(evaluator.score(false).done[0]);
  }
}

TEST(Evaluator, CommandedForceIsSharedAmongContacts) {
  TaskEvaluator evaluator(in_scene(kTask));
  for (std::uint64_t n = 0; n < 10; ++n) {
    TickRecord tick = tick_at(n, 1000);
    touch(tick.device[0], 0, kNerve, 6);
    touch(tick.device[0], 1, kMeniscus, 2);
    tick.device[0].force_N = {0, 0, 4};
    ASSERT_TRUE(evaluator.observe(tick).ok());
  }
  EXPECT_NEAR(value(evaluator.score(false), Metric::kPeakForce), 1, 1e-9);
  EXPECT_NEAR(evaluator.touch_N(), 4, 1e-9);
}

constexpr const char* kHalves = R"(title = "Halves"
end = "recording"
[[region]]
name = "right"
structures = [3]
plane_point = [0.5, 0, 0]
plane_normal = "right"
[[region]]
name = "left"
structures = [3]
plane_point = [-0.5, 0, 0]
plane_normal = "left"
[[step]]
name = "touch the right half"
region = "right"
seconds = 0.2
[[step]]
name = "touch the left half"
region = "left"
seconds = 0.2
[[metric]]
name = "steps_done"
)";

TEST(Evaluator, EachRegionNeedsATouchOfItsOwn) {
  // a voxel at the origin, in both halves
  Model model = model_of_labels();
  GridGeometry grid;
  grid.dims = {4, 4, 4};
  Volume<LabelId> labels(grid, 0);
  labels.at(0, 0, 0) = kMeniscus;
  model.labels = label_bricks(labels);
  const auto file = parse_task(kHalves, "task.toml");
  ASSERT_TRUE(file.ok()) << file.error().message();
  const auto found = resolve_task(*file, model);
  ASSERT_TRUE(found.ok()) << found.error().message();
  const auto touched = [&](auto position_of_ms) {
    TaskEvaluator evaluator(*found);
    for (std::uint64_t n = 0; n < 1000; ++n) {
      TickRecord tick = tick_at(n, 1000);
      if (const std::optional<double> x_mm = position_of_ms(n)) {
        touch(tick.device[0], 0, kMeniscus, 1);
        tick.device[0].contact_patient_mm = {*x_mm, 0, 0};
      }
      EXPECT_TRUE(evaluator.observe(tick).ok());
    }
    const std::vector<bool> done = evaluator.score(false).done;
    return std::pair<bool, bool>{done[0], done[1]};
  };
  using Value = std::optional<double>;
  EXPECT_EQ(touched([](auto) { return Value(0.0); }), std::pair(true, false)) << "one touch in both halves";
  EXPECT_EQ(touched([](auto n) { return n == 500 ? Value() : Value(0.0); }), std::pair(true, true));
  EXPECT_EQ(touched([](auto n) { return Value(n < 500 ? 0.0 : 1.4); }), std::pair(true, false))
      << "hardly moved";
  EXPECT_EQ(touched([](auto n) { return Value(n < 500 ? -1.0 : 1.0); }), std::pair(true, true))
      << "a place of its own";
}

TEST(Evaluator, CoverageIsIndependentOfTheRate) {
  std::string text = R"(title = "Cover"
end = "recording"
[[region]]
name = "slab"
structures = [3]
[[step]]
name = "cover"
region = "slab"
kind = "cover"
coverage = 0.5
[[metric]]
name = "coverage"
)";
  // a slab of 40 by 1 by 1 mm
  Model model = model_of_labels();
  GridGeometry grid;
  grid.dims = {40, 1, 1};
  const Volume<LabelId> labels(grid, kMeniscus);
  model.labels = label_bricks(labels);
  const auto file = parse_task(text, "task.toml");
  ASSERT_TRUE(file.ok()) << file.error().message();
  const auto found = resolve_task(*file, model);
  ASSERT_TRUE(found.ok()) << found.error().message();
  // from `from_mm` to `to_mm` in a second, along the upper face
  const auto covered = [&](double rate_hz, double from_mm, double to_mm, double force_N, bool lifts) {
    TaskEvaluator evaluator(*found);
    for (std::uint64_t n = 0; n <= static_cast<std::uint64_t>(rate_hz); ++n) {
      TickRecord tick = tick_at(n, rate_hz);
      if (!lifts || std::fmod(tick.time_s, 0.05) > 0.004) touch(tick.device[0], 0, kMeniscus, force_N);
      tick.device[0].contact_patient_mm = {from_mm + (to_mm - from_mm) * tick.time_s, 0, 0.5};
      EXPECT_TRUE(evaluator.observe(tick).ok());
    }
    return value(evaluator.score(false), Metric::kCoverage);
  };
  for (const double rate_hz : kRates_Hz) {
    EXPECT_EQ(covered(rate_hz, 10, 10, 2, false), 0) << "a press sweeps nothing";
    EXPECT_EQ(covered(rate_hz, 10, 11.9, 2, false), 0) << "nor does a hand that slips a little";
    EXPECT_EQ(covered(rate_hz, 10, 30, 0.19, false), 0) << "too light";
    EXPECT_EQ(covered(rate_hz, 10, 30, 2, true), 0) << "twenty touches";
    const double half = covered(rate_hz, 10, 30, 2, false), whole = covered(rate_hz, -1, 40, 2, false);
    EXPECT_NEAR(half / whole, 0.5, 0.05);
    EXPECT_EQ(covered(rate_hz, 30, 10, 2, false), half);
  }
}

TEST(Evaluator, ARunBeginsWithItsFirstTick) {
  TaskEvaluator evaluator(in_scene(kTask));
  for (std::uint64_t n = 2500; n < 2600; ++n) ASSERT_TRUE(evaluator.observe(tick_at(n, 1000)).ok());
  EXPECT_NEAR(evaluator.score(false).started_s, 2.5, 1e-12);
  EXPECT_NEAR(evaluator.score(false).time_s, 0.099, 1e-9);
}

TEST(Evaluator, AStepNeedsItsForceWithoutABreak) {
  TaskEvaluator evaluator(in_scene(kTask));
  // 0.4 s in the band, one tick above it, 0.4 s in the band
  for (std::uint64_t n = 0; n < 801; ++n) {
    TickRecord tick = tick_at(n, 1000);
    touch(tick.device[0], 0, kMeniscus, n == 400 ? 3.7 : 3);
    ASSERT_TRUE(evaluator.observe(tick).ok());
  }
  EXPECT_FALSE(evaluator.score(false).done[0]);
  for (std::uint64_t n = 801; n < 902; ++n) {
    TickRecord tick = tick_at(n, 1000);
    touch(tick.device[0], 0, kMeniscus, 3);
    ASSERT_TRUE(evaluator.observe(tick).ok());
  }
  const TaskScore score = evaluator.score(false);
  EXPECT_TRUE(score.done[0]);
  EXPECT_FALSE(score.done[1]);
  // half a second after tick 401
  EXPECT_NEAR(score.events[0].time_s, 0.901, 0.0011);
}

TEST(Evaluator, OrderedStepsWaitForThoseBefore) {
  std::string text = kTask;
  text.replace(text.find("end = \"recording\""), 17, "ordered = true\nend = \"steps\"");
  TaskEvaluator evaluator(in_scene(text));
  std::uint64_t n = 0;
  const auto run = [&](double at_mm, double force_N, int ticks) {
    for (int i = 0; i < ticks; ++i) {
      TickRecord tick = tick_at(n++, 1000);
      tick.device[0].tip_patient_mm = {at_mm, 0, 0};
      if (force_N > 0) touch(tick.device[0], 0, kMeniscus, force_N);
      ASSERT_TRUE(evaluator.observe(tick).ok());
    }
  };
  run(100, 0, 300);
  EXPECT_FALSE(evaluator.score(false).done[1]);
  run(0, 3, 600);
  EXPECT_TRUE(evaluator.score(false).done[0]);
  run(100, 0, 300);
  EXPECT_TRUE(evaluator.ended());
  const std::uint64_t ticks = evaluator.score(false).ticks;
  run(50, 0, 300);  // nothing after the end counts
  EXPECT_EQ(evaluator.score(true).ticks, ticks);
  EXPECT_FALSE(evaluator.score(true).cut_short);
}

constexpr const char* kScopeTask = R"(title = "Watch"
end = "recording"
[scope]
optics = 0
back = 0
[[region]]
name = "meniscus"
structures = [3]
[[step]]
name = "push"
region = "meniscus"
seconds = 0.7
seen = true
[[metric]]
name = "unseen_time"
[[metric]]
name = "steps_done"
)";

/// A run of 12 s with 10 s of contact, at a point that oscillates sinusoidally with a period of 4 s below a
/// scope that looks down from 50 mm above.
template <class Take>
void watched_run(double rate_hz, double swing_mm, const Take& take) {
  const auto count = static_cast<std::uint64_t>(std::llround(12 * rate_hz));
  for (std::uint64_t n = 0; n <= count; ++n) {
    TickRecord tick = tick_at(n, rate_hz);
    tick.devices = 2;
    tick.device[1].tip_patient_mm = {0, 0, 50};
    if (tick.time_s > 1 && tick.time_s < 11) touch(tick.device[0], 0, kMeniscus, 1);
    const double phase = 2 * std::numbers::pi * (tick.time_s - 1) / 4;
    tick.device[0].contact_patient_mm = {swing_mm * std::sin(phase), 0, 0};
    take(tick);
  }
}

TEST(Evaluator, ContactOutsideTheViewMatchesGeometryAtEveryRate) {
  const double border_mm = 50 * std::tan(ScopeOptics::kHalfField_deg * std::numbers::pi / 180);
  for (const double rate_hz : kRates_Hz) {
    TaskEvaluator evaluator(in_scene(kScopeTask));
    std::vector<std::uint64_t> unseen;
    // an oscillation of twice the field's radius is outside for two thirds of the time
    watched_run(rate_hz, 2 * border_mm, [&](const TickRecord& tick) {
      const bool was = evaluator.touches_invisible();
      ASSERT_TRUE(evaluator.observe(tick).ok());
      if (evaluator.touches_invisible() && !was) unseen.push_back(tick.tick);
    });
    const TaskScore score = evaluator.score(false);
    EXPECT_NEAR(value(score, Metric::kUnseenTime) / (10 * 2.0 / 3), 1, 1e-3) << rate_hz;
    ASSERT_EQ(unseen.size(), 5u);
    std::vector<std::uint64_t> reported;
    for (const TaskEvent& event : score.events)
      if (event.kind == TaskEvent::Kind::kUnseen) reported.push_back(event.tick);
    EXPECT_EQ(reported, unseen) << "the tick in which it goes out of view";
    // it is visible for two thirds of a second at a time
    EXPECT_FALSE(score.done[0]);
    TaskEvaluator still(in_scene(kScopeTask));
    watched_run(rate_hz, 0.99 * border_mm,
                [&](const TickRecord& tick) { ASSERT_TRUE(still.observe(tick).ok()); });
    EXPECT_EQ(value(still.score(false), Metric::kUnseenTime), 0);
    EXPECT_TRUE(still.score(false).done[0]);
  }
}

TEST(Evaluator, AScopeNeedsASecondDevice) {
  TaskEvaluator evaluator(in_scene(kScopeTask));
  EXPECT_THAT(evaluator.observe(tick_at(0, 1000)).error().what, HasSubstr("two devices"));
}

/// Volume of the intersection of two balls with centres d apart.
double common_mm3(double a, double b, double d) {
  return std::numbers::pi * std::pow(a + b - d, 2) * (d * d + 2 * d * (a + b) - 3 * (a - b) * (a - b)) /
         (12 * d);
}
double ball_mm3(double r) {
  return 4.0 / 3 * std::numbers::pi * r * r * r;
}

/// A removal task with a plan, in the ball with a burr.
class TakeOff : public ::testing::Test {
 protected:
  void SetUp() override {
    std::ofstream(folder_ / "plan.toml") << R"(title = "Sphere"
[[trajectory]]
name = "down"
entry = [0, 0, 15]
target = [0, 0, 3]
[[region]]
name = "sphere"
shape = "sphere"
trajectory = "down"
radius = 5
)";
    std::ofstream(folder_ / "task.toml") << R"(title = "Take off"
end = "recording"
plan = "plan.toml"
[[step]]
name = "some of it"
kind = "remove"
region = "sphere"
coverage = 0.08
[[protected]]
structures = ["ball"]
[microscope]
from = "superior"
[[metric]]
name = "bone_left"
structures = ["ball"]
[[metric]]
name = "burr_distance"
structures = ["ball"]
[[metric]]
name = "force_near"
structures = ["ball"]
within = 1
[[metric]]
name = "hidden_time"
[[metric]]
name = "removed_in_plan"
[[metric]]
name = "removed_outside"
[[metric]]
name = "protected_removed"
[[metric]]
name = "depth_past_plan"
)";
  }
  TaskInScene task(const Model& model) {
    const auto file = load_task((folder_ / "task.toml").string());
    PALPATE_CHECK(file.ok());
    auto found = resolve_task(*file, model);
    PALPATE_CHECK(found.ok());
    return *std::move(found);
  }
  /// A second in which a ball of radius 4 mm is removed at half time, 6 mm from the centre of the planned
  /// one.
  static Recording run(double rate_hz) {
    Recording run;
    run.header.rate_hz = rate_hz;
    for (std::uint64_t n = 0; n <= static_cast<std::uint64_t>(rate_hz); ++n)
      run.ticks.push_back(tick_at(n, rate_hz));
    const auto half = static_cast<std::uint64_t>(rate_hz / 2);
    RecordingEvent sweep;
    sweep.kind = RecordingEvent::Kind::kSweep;
    sweep.tick = half;
    sweep.number = 2;
    sweep.sweep.from_mm = sweep.sweep.to_mm = {6, 0, 3};
    sweep.sweep.radius_mm = 4;
    run.events = {sweep, change(half, 2, ModelChange::kCut)};
    run.summary.emplace();
    return run;
  }
  static RecordingEvent change(std::uint64_t tick, std::uint32_t version, std::uint32_t kind) {
    RecordingEvent event;
    event.tick = tick;
    event.number = event.change.version = version;
    event.change.tissue = kind;
    return event;
  }
  TaskScore score(const Recording& recording, const TickRange& range = {}) {
    const auto scored = score_recording(task(*loaded_.model), RecordingSource(recording), {}, range);
    PALPATE_CHECK(scored.ok());
    return *scored;
  }

  test::TemporaryFolder folder_;
  LoadedScene loaded_ = testing::loaded_burr();
};

TEST_F(TakeOff, VolumesAndDepthAreThoseOfGeometryAtEveryRate) {
  const double in_mm3 = common_mm3(5, 4, 6);
  for (const double rate_hz : kRates_Hz) {
    const TaskScore made = score(run(rate_hz));
    EXPECT_NEAR(value(made, Metric::kRemovedInPlan) / in_mm3, 1, 0.02);
    EXPECT_NEAR(value(made, Metric::kRemovedOutside) / (ball_mm3(4) - in_mm3), 1, 0.02);
    EXPECT_NEAR(value(made, Metric::kProtectedRemoved) / ball_mm3(4), 1, 0.02);
    // 6 + 4 - 5; sampled at points that are 0.15 and 0.225 mm apart
    EXPECT_NEAR(value(made, Metric::kDepthPastPlan), 5, 0.15);
    EXPECT_LE(value(made, Metric::kDepthPastPlan), 5);
    // evaluated in the tick of the cut
    ASSERT_TRUE(made.done[0]);
    EXPECT_EQ(made.events[0].tick, static_cast<std::uint64_t>(rate_hz / 2));
  }
}

// The running burr of 2 mm radius stands 3 mm above the surface, then 1 mm deep in it for 0.3 s, then in the
// middle of the ball, where nothing was removed, for 0.2 s.
TEST_F(TakeOff, ARunningBurrIsMeasuredNearStructuresAndWhereItIsHidden) {
  for (const double rate_hz : kRates_Hz) {
    const auto told = [&](std::uint8_t switches) {
      Recording recording = run(rate_hz);
      recording.events.clear();
      for (TickRecord& tick : recording.ticks) {
        const double t = tick.time_s;
        tick.switches = switches;
        const double z = t < 0.2 ? 20 : t < 0.5 ? 16 : 0;
        tick.device[0].proxy_patient_mm = {0, 0, z};
        if (t < 0.2 || t >= 0.7) continue;
        tick.device[0].flags = kFlagContact;
        touch(tick.device[0], 0, testing::kBone, t < 0.5 ? 1.5 : 0.5);
      }
      return score(recording);
    };
    const TaskScore running = told(kSwitchMotor);
    EXPECT_NEAR(value(running, Metric::kBurrDistance), -17, 0.2) << rate_hz;
    EXPECT_NEAR(value(running, Metric::kForceNear), 1.5, 1e-9);
    EXPECT_NEAR(value(running, Metric::kHiddenTime), 0.2, 0.011) << "a look every 10 ms";
    EXPECT_TRUE(std::isnan(value(running, Metric::kBoneLeft))) << "nothing was removed";
    const TaskScore still = told(0);
    EXPECT_TRUE(std::isnan(value(still, Metric::kBurrDistance)));
    EXPECT_EQ(value(still, Metric::kForceNear), 0);
    EXPECT_EQ(value(still, Metric::kHiddenTime), 0);
  }
  // the distance from a ball of 4 mm whose centre is 6 mm beside the middle and 3 mm above
  EXPECT_LT(value(score(run(1000)), Metric::kBoneLeft), -4);
}

TEST_F(TakeOff, CountsRemovalUpToTheLastTick) {
  Recording recording = run(1000);
  const TaskScore before = score(recording, {0, 499}), with = score(recording, {600, 900});
  EXPECT_EQ(value(before, Metric::kRemovedOutside), 0);
  EXPECT_EQ(value(before, Metric::kDepthPastPlan), 0);
  EXPECT_FALSE(before.done[0]);
  EXPECT_GT(value(with, Metric::kRemovedOutside), 100) << "what is gone is gone";
  EXPECT_EQ(with.events[0].tick, 600u);
  // undone removal does not count
  recording.events.push_back(change(700, 3, ModelChange::kUndo));
  EXPECT_EQ(value(score(recording), Metric::kRemovedInPlan), 0);
  EXPECT_GT(value(score(recording, {0, 699}), Metric::kRemovedInPlan), 1);
}

TEST_F(TakeOff, LiveScoreEqualsRecordedScoreBitForBit) {
  const Recording recording = run(1000);
  TaskEvaluator live(task(*loaded_.model));
  auto event = recording.events.begin();
  for (const TickRecord& tick : recording.ticks) {
    for (; event != recording.events.end() && event->tick <= tick.tick; ++event) live.on_event(*event);
    ASSERT_TRUE(live.observe(tick).ok());
    if (tick.tick == 499) {
      EXPECT_EQ(live.fraction_of_step(0), 0);
    }
  }
  EXPECT_EQ(live.fraction_of_step(0), 1);
  EXPECT_EQ(live.score(false).hash, score(recording).hash);
}

TEST_F(TakeOff, NeedsAToolThatTakesAndSomethingToTake) {
  const auto file = load_task((folder_ / "task.toml").string());
  ASSERT_TRUE(file.ok());
  EXPECT_THAT(resolve_task(*file, *testing::loaded_ball().model).error().message(),
              HasSubstr("no tool of the scene"));
  std::ofstream(folder_ / "plan.toml", std::ios::app) << "depth = -20\n";
  const auto beside = load_task((folder_ / "task.toml").string());
  ASSERT_TRUE(beside.ok()) << beside.error().message();
  EXPECT_THAT(resolve_task(*beside, *loaded_.model).error().message(), HasSubstr("nothing removable"));
}

TEST(Evaluator, UnknownMetricsAreOutOfBand) {
  TaskEvaluator evaluator(in_scene(kTask));
  for (std::uint64_t n = 0; n < 100; ++n) ASSERT_TRUE(evaluator.observe(tick_at(n, 1000)).ok());
  const TaskScore score = evaluator.score(false);
  EXPECT_TRUE(std::isnan(value(score, Metric::kPeakForce)));
  EXPECT_FALSE(score.in_band);
}

TEST(Evaluator, RunsThatWereCutOrHaveGapsDoNotPass) {
  std::string text = kTask;
  const auto run = [&](bool gap) {
    TaskEvaluator evaluator(in_scene(text));
    for (std::uint64_t n = 0; n < 1000; ++n) {
      if (gap && n > 500 && n < 600) continue;
      TickRecord tick = tick_at(n, 1000);
      touch(tick.device[0], 0, kMeniscus, 2);
      EXPECT_TRUE(evaluator.observe(tick).ok());
    }
    return evaluator;
  };
  EXPECT_TRUE(run(false).score(false).in_band);
  EXPECT_FALSE(run(false).score(true).in_band);
  EXPECT_NEAR(run(true).score(false).missing_s, 0.1, 1e-6);
  EXPECT_FALSE(run(true).score(false).in_band);
}

TEST(Evaluator, AcceptsNonFiniteNumbers) {
  const double odd[] = {kNoValue, std::numeric_limits<double>::infinity(), -1, 1e300, -0.0};
  TaskEvaluator evaluator(in_scene(kTask));
  std::uint64_t n = 0;
  for (const double a : odd) {
    for (const double b : odd) {
      TickRecord tick = tick_at(n++, 1000);
      tick.device[0].tip_patient_mm = {a, b, a};
      touch(tick.device[0], 0, kMeniscus, b);
      touch(tick.device[0], 1, 65535, a);
      tick.device[0].contact_patient_mm[0] = a;
      ASSERT_TRUE(evaluator.observe(tick).ok());
    }
  }
  for (const MetricValue& value : evaluator.score(false).metrics) EXPECT_FALSE(std::isinf(value.value));
  TickRecord late = tick_at(n, 1000);
  late.time_s = 0;
  EXPECT_THAT(evaluator.observe(late).error().what, HasSubstr("clock"));
  late.time_s = kNoValue;
  EXPECT_FALSE(evaluator.observe(late).ok());
}

TEST(Evaluator, AnAnswerIsTheLastPlaceThatWasRestedOn) {
  const std::string text = R"(title = "Find"
end = "recording"
[answer]
structures = ["nerve"]
seconds = 0.5
[[metric]]
name = "answer_error"
at_most = 3
)";
  TaskEvaluator evaluator(in_scene(text));
  std::uint64_t n = 0;
  const auto run = [&](double x, double force_N, int ticks) {
    for (int i = 0; i < ticks; ++i) {
      TickRecord tick = tick_at(n++, 1000);
      touch(tick.device[0], 0, kMeniscus, force_N);
      tick.device[0].contact_patient_mm[0] = x;
      tick.device[0].contact_patient_mm[1] = 2;
      tick.device[0].contact_patient_mm[2] = 9;
      ASSERT_TRUE(evaluator.observe(tick).ok());
    }
  };
  EXPECT_TRUE(std::isnan(evaluator.score(false).metrics[0].value));
  run(12, 1, 600);
  // the nerve's voxel is at (2, 2, 2), the normal along z
  EXPECT_NEAR(evaluator.score(false).metrics[0].value, 10, 1e-9);
  run(4, 1, 600);
  EXPECT_NEAR(evaluator.score(false).metrics[0].value, 2, 1e-9);
  run(30, 1, 300);    // too short
  run(40, 0.1, 900);  // too light
  EXPECT_NEAR(evaluator.score(false).metrics[0].value, 2, 1e-9);
  EXPECT_TRUE(evaluator.score(false).in_band);
}

TEST(RunsInARow, CountsFromTheLast) {
  EXPECT_EQ(runs_in_a_row({}), 0);
  EXPECT_EQ(runs_in_a_row({true, false, true, true}), 2);
  EXPECT_EQ(runs_in_a_row({true, true, false}), 0);
}

}  // namespace
}  // namespace palpate
