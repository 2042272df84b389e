#include "verification/latency.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "loading/test_loading.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::loaded_ball;

// loaded once, because a run takes a moment
const LoadedScene& ball_contact() {
  static const LoadedScene loaded = loaded_ball();
  return loaded;
}
const PalpationPath& ball_path() {
  static const PalpationPath path = palpate_once(ball_contact()).value();
  return path;
}

std::map<std::string, Figure> by_name(const std::vector<Figure>& figures) {
  std::map<std::string, Figure> map;
  for (const Figure& figure : figures) EXPECT_TRUE(map.emplace(figure.name, figure).second) << figure.name;
  return map;
}

TEST(PalpationPath, StrokesTheStructureInOneLongTouch) {
  const PalpationPath& path = ball_path();
  ASSERT_EQ(path.states.size(), path.intended.size());
  ASSERT_LT(path.touch_begin, path.touch_end);
  ASSERT_LE(path.touch_end, path.states.size());
  // pressing, holding and stroking take more than a second, and the approach is in free space
  EXPECT_GT(static_cast<double>(path.touch_end - path.touch_begin) / path.rate_hz, 1.0);
  EXPECT_GT(path.in_contact, 0.1);
  EXPECT_LT(path.in_contact, 1.0);

  // contact over 5 mm of surface, with the tip close to it everywhere
  const Transform<Patient, World> X_PatientWorld = ball_contact().model->X_WorldPatient.inverse();
  double farthest_mm = 0;
  for (std::size_t t = path.touch_begin; t < path.touch_end; ++t) {
    const Point<Patient> tip = X_PatientWorld * path.states[t].tip;
    EXPECT_NEAR((tip - Point<Patient>()).norm(), testing::kBoneRadius_mm, 4.0) << t;
    farthest_mm = std::max(farthest_mm, (path.states[t].tip - path.states[path.touch_begin].tip).norm());
  }
  EXPECT_GT(farthest_mm, 4.0);
}

TEST(PalpationPath, IsTheSameEveryTime) {
  const auto again = palpate_once(ball_contact());
  ASSERT_TRUE(again.ok());
  ASSERT_EQ(again->states.size(), ball_path().states.size());
  for (std::size_t t = 0; t < again->states.size(); t += 97)
    EXPECT_EQ(again->states[t].tip.eigen(), ball_path().states[t].tip.eigen()) << t;
}

TEST(PalpationPath, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto path = palpate_once(ball_contact(), Progress({}, &stop));
  ASSERT_FALSE(path.ok());
  EXPECT_EQ(path.error().kind, ErrorKind::kInterrupted);
}

TEST(PaceMeter, CountsEveryTickOfItsBlocksInContact) {
  const auto meter = PaceMeter::create(ball_contact().model, ball_path(), {.rate_hz = 1000});
  constexpr double kSeconds = 0.2;
  for (int block = 0; block < 2; ++block) {
    ASSERT_TRUE(meter->servo_block(kSeconds).ok());
    ASSERT_TRUE(meter->bare_block(kSeconds).ok());
  }
  const PaceFigures figures = meter->figures();
  // on a loaded machine points in time are skipped and blocks start and end late, but no ticks are added
  EXPECT_GT(figures.ticks, 0u);
  EXPECT_GE(static_cast<double>(figures.ticks + figures.skipped + figures.dropped),
            2 * kSeconds * 1000 * 0.8);
  // for EmptyLoopResult: more only if the last points of a block were skipped
  EXPECT_GE(figures.bare_ticks + figures.bare_skipped, 400u);
  EXPECT_LE(figures.bare_ticks, 400u);
  EXPECT_EQ(figures.dropped, 0u);
  EXPECT_GT(figures.in_contact, 0.9) << "the hand strokes";
  EXPECT_GT(figures.compute.p50_us, 0);
  for (const Percentiles& p : {figures.compute, figures.lateness, figures.bare_lateness}) {
    EXPECT_LE(p.p50_us, p.p99_us);
    EXPECT_LE(p.p99_us, p.p999_us);
    EXPECT_LE(p.p999_us, p.max_us);
  }
  EXPECT_GT(figures.typical_p50.bare_us, 0);
  EXPECT_GT(figures.typical_p50.servo_us, 0);
  EXPECT_GT(figures.typical_p99.bare_us, 0);
  EXPECT_LE(figures.typical_p99.servo_us, figures.lateness.max_us);
  EXPECT_LE(figures.typical_p99.bare_us, figures.bare_lateness.max_us);
  EXPECT_LE(figures.min_p50.servo_us * figures.typical_p50.bare_us,
            figures.typical_p50.servo_us * figures.min_p50.bare_us);
  EXPECT_GE(figures.on_time, 0);
  EXPECT_LE(figures.on_time, 1);
  EXPECT_FALSE(figures.scheduling.scheduler.empty());
}

TEST(PaceMeter, ABlockOfEachIsAPairInWhicheverOrder) {
  const auto meter = PaceMeter::create(ball_contact().model, ball_path(), {.rate_hz = 1000});
  constexpr double kSeconds = 0.05;
  ASSERT_TRUE(meter->bare_block(kSeconds).ok());
  EXPECT_EQ(meter->figures().typical_p50.bare_us, 0) << "no pair yet";
  ASSERT_TRUE(meter->servo_block(kSeconds).ok());
  const PaceFigures first = meter->figures();
  EXPECT_GT(first.typical_p50.bare_us, 0);
  EXPECT_EQ(first.min_p50.servo_us, first.typical_p50.servo_us) << "of one pair";
  ASSERT_TRUE(meter->servo_block(kSeconds).ok());
  const PaceFigures half = meter->figures();
  EXPECT_EQ(half.typical_p50.servo_us, first.typical_p50.servo_us);
  EXPECT_EQ(half.typical_p50.bare_us, first.typical_p50.bare_us);
}

TEST(PaceMeter, RefusesARateThatTheLoopRefuses) {
  const auto meter = PaceMeter::create(ball_contact().model, ball_path(), {.rate_hz = 20});
  const auto measured = meter->servo_block(0.1);
  ASSERT_FALSE(measured.ok());
  EXPECT_EQ(measured.error().kind, ErrorKind::kUsage);
}

TEST(PaceMeter, BothBlocksCanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto meter = PaceMeter::create(ball_contact().model, ball_path(), {});
  for (const auto& measured :
       {meter->servo_block(600, Progress({}, &stop)), meter->bare_block(600, Progress({}, &stop))}) {
    ASSERT_FALSE(measured.ok());
    EXPECT_EQ(measured.error().kind, ErrorKind::kInterrupted);
  }
  EXPECT_EQ(meter->figures().ticks, 0u);
}

TEST(FreeRunning, AWholeUpdateCostsMoreThanItsTick) {
  for (const ForceMethodInfo& info : kDirectMethods) {
    const auto model = prepared_with_cache(ball_contact().model, {&info.method, 1});
    ASSERT_TRUE(model.ok());
    EXPECT_FALSE(info.name.empty());
    const auto ticks = time_ticks(**model, ball_path(), info.method, 3);
    const auto updates = time_updates(*model, ball_path(), info.method, 3);
    const Percentiles contact = time_ticks_in_contact(**model, ball_path(), info.method);
    EXPECT_GT(contact.p50_us, 0);
    EXPECT_LE(contact.p50_us, contact.p99_us);
    EXPECT_LE(contact.p99_us, contact.p999_us);
    EXPECT_LE(contact.p999_us, contact.max_us);
    ASSERT_EQ(ticks.size(), 3u);
    ASSERT_TRUE(updates.ok());
    ASSERT_EQ(updates->size(), 3u);
    // minimum over the rounds, the least disturbed one
    const double tick_ns = *std::min_element(ticks.begin(), ticks.end());
    const double update_ns = *std::min_element(updates->begin(), updates->end());
    EXPECT_GT(tick_ns, 0);
    // for slower methods the variation of the tick exceeds the additional cost of the update
    if (info.method == ForceMethod::kTrilinear) {
      EXPECT_GT(update_ns, tick_ns);
    }
  }
}

TEST(FreeRunning, ATicksCostIsTheMiddleOfManyPairsOfSlices) {
  const auto cost_of = [](ForceMethod method) {
    const auto model = prepared_with_cache(ball_contact().model, {&method, 1});
    PALPATE_CHECK(model.ok());
    return time_ticks_beside_bare(**model, ball_path(), method, 2);
  };
  const TickCost trilinear = cost_of(ForceMethod::kTrilinear), sphere = cost_of(ForceMethod::kSmoothSphere);
  for (const TickCost& cost : {trilinear, sphere}) {
    EXPECT_GT(cost.bare_ns, 0);
    EXPECT_GT(cost.tick_ns, 0);
    EXPECT_GT(cost.ratio, 0);
  }
  // three times the work
  EXPECT_GT(sphere.ratio, trilinear.ratio);
}

TEST(Median, IsTheMiddleValue) {
  EXPECT_EQ(median({3}), 3);
  EXPECT_EQ(median({5, 1, 3}), 3);
  EXPECT_EQ(median({4, 1, 3, 2}), 3);
}

TEST(LatencyLimit, IsTheLargerOfAFifthAndATick) {
  EXPECT_DOUBLE_EQ(lateness_ratio_limit(100, 2), 1.2);
  EXPECT_DOUBLE_EQ(lateness_ratio_limit(10, 2), 1.2);
  EXPECT_DOUBLE_EQ(lateness_ratio_limit(1, 2), 3);
  EXPECT_DOUBLE_EQ(lateness_ratio_limit(0.1, 2), 21);
  // the limit is independent of the machine's speed
  EXPECT_DOUBLE_EQ(lateness_ratio_limit(1, 2), lateness_ratio_limit(10, 20));
}

PaceFigures within_limit() {
  PaceFigures pace;
  pace.compute = {1, 2, 3, 4};
  pace.lateness = {22, 44, 60, 90};
  pace.bare_lateness = {20, 40, 50, 80};
  pace.typical_p50 = pace.min_p50 = {22, 20};
  pace.typical_p99 = pace.min_p99 = {44, 40};
  pace.ticks = pace.bare_ticks = 3000;
  pace.scheduling.realtime = true;
  return pace;
}

bool all_within_limit(const PaceFigures& pace) {
  const auto figures = pace_figures(4000, pace);
  return std::all_of(figures.begin(), figures.end(), [](const Figure& figure) { return figure.ok(); });
}

TEST(PaceFigures, BreakALimitForTheProgramsOwnDoingOnly) {
  EXPECT_TRUE(all_within_limit(within_limit()));
  const auto figures = by_name(pace_figures(4000, within_limit()));
  EXPECT_DOUBLE_EQ(figures.at("4-kHz/lateness/ratio/p50").value, 1.1);
  EXPECT_DOUBLE_EQ(figures.at("4-kHz/lateness/ratio/p99").value, 1.1);
  EXPECT_DOUBLE_EQ(figures.at("4-kHz/lateness/least-ratio/p99").value, 1.1);

  const auto with = [](auto change) {
    PaceFigures pace = within_limit();
    change(pace);
    return all_within_limit(pace);
  };
  EXPECT_FALSE(with([](PaceFigures& p) { p.dropped = 1; }));
  EXPECT_FALSE(with([](PaceFigures& p) { p.min_p50.servo_us = 25; }));
  EXPECT_FALSE(with([](PaceFigures& p) { p.min_p99.servo_us = 49; }));

  // attributable to the machine
  EXPECT_TRUE(with([](PaceFigures& p) { p.lateness.p999_us = p.lateness.max_us = 1e5; }));
  EXPECT_TRUE(with([](PaceFigures& p) { p.skipped = p.late.steal = 100; }));
  EXPECT_TRUE(with([](PaceFigures& p) { p.on_time = 0.5; }));
  EXPECT_TRUE(with([](PaceFigures& p) { p.lateness.p99_us = 4000; })) << "in other blocks than most";
  EXPECT_TRUE(with([](PaceFigures& p) { p.typical_p99.servo_us = 4000; })) << "in some pairs alone";
  EXPECT_TRUE(with([](PaceFigures& p) {
    p.min_p50 = {0.1, 0.06};
    p.min_p99 = {1.9, 1};
  })) << "less than a tick takes is no difference";
  // a machine with a hundredth of the speed
  EXPECT_TRUE(with([](PaceFigures& p) {
    for (Percentiles* of : {&p.compute, &p.lateness, &p.bare_lateness})
      for (double* us : {&of->p50_us, &of->p99_us, &of->p999_us, &of->max_us}) *us *= 100;
    for (LatenessPair* pair : {&p.typical_p50, &p.typical_p99, &p.min_p50, &p.min_p99})
      *pair = {100 * pair->servo_us, 100 * pair->bare_us};
  }));
  EXPECT_TRUE(with([](PaceFigures& p) {
    p.scheduling.realtime = false;
    p.min_p99.servo_us = 4000;
  })) << "an ordinary thread";
  EXPECT_TRUE(with([](PaceFigures& p) {
    p.ticks = 200;
    p.min_p99.servo_us = 4000;
  })) << "too few ticks for a p99";
}

TEST(PaceFigures, AreFiniteWithoutABareBlock) {
  PaceFigures pace = within_limit();
  pace.bare_lateness = {};
  pace.typical_p50 = pace.typical_p99 = pace.min_p50 = pace.min_p99 = {};
  for (const Figure& figure : pace_figures(1000, pace))
    EXPECT_TRUE(std::isfinite(figure.value)) << figure.name;
}

TEST(Latency, MeasuresTheRequestedCases) {
  SuiteOptions options;
  options.seconds = 0.1;
  options.rate_hz = 2000;
  options.spin_us = 50;
  const auto report = measure_latency(ball_contact(), options);
  ASSERT_TRUE(report.ok()) << report.error().message();
  const auto json = nlohmann::json::parse(to_json(*report));
  for (const char* note : {"scheduler", "memory", "scene", "pace", "founding"})
    EXPECT_FALSE(json["notes"][note].get<std::string>().empty()) << note;
  EXPECT_THAT(json["notes"]["pace"].get<std::string>(), HasSubstr("spin 50 us"));

  const auto figures = by_name(report->figures);
  for (const auto& [name, figure] : figures) {
    EXPECT_TRUE(std::isfinite(figure.value)) << name;
    EXPECT_TRUE(name.starts_with("2-kHz/") || name.starts_with("free-running/")) << name;
    // absolute times depend on the machine and have no limit
    if (figure.limit) {
      EXPECT_TRUE(figure.unit == "ratio" || figure.unit == "times" || figure.unit == "ticks") << name;
    }
  }
  for (const char* name :
       {"2-kHz/compute/p50", "2-kHz/compute/max", "2-kHz/lateness/servo/p99.9", "2-kHz/lateness/bare/p99",
        "2-kHz/lateness/ratio/p50", "2-kHz/lateness/least-ratio/p99", "free-running/trilinear/time/bare",
        "free-running/trilinear/of-bare/tick", "free-running/smooth-sphere/of-bare/tick",
        "2-kHz/share/on-time", "2-kHz/ticks/dropped", "2-kHz/ticks/steal", "2-kHz/ticks/run-queue",
        "free-running/trilinear/time/tick", "free-running/trilinear/time/update",
        "free-running/trilinear/of-R4400/tick", "free-running/trilinear/of-Pentium-Pro/update"})
    EXPECT_EQ(figures.count(name), 1u) << name;
  EXPECT_GT(figures.at("2-kHz/compute/p50").value, 0);
  EXPECT_TRUE(figures.at("free-running/trilinear/of-bare/tick").limit);
  const double rate_kHz = figures.at("free-running/trilinear/rate/tick").value;
  EXPECT_NEAR(rate_kHz * figures.at("free-running/trilinear/time/tick").value, 1e6, 1);
  EXPECT_NEAR(figures.at("free-running/trilinear/of-R4400/tick").value * 4.8, rate_kHz, 1e-6 * rate_kHz);
  EXPECT_NEAR(figures.at("free-running/trilinear/of-Pentium-Pro/tick").value * 6.5, rate_kHz,
              1e-6 * rate_kHz);
}

TEST(Latency, RejectsInvalidTimeAndScene) {
  SuiteOptions options;
  options.seconds = 0;
  EXPECT_EQ(run_suite("latency", options).error().kind, ErrorKind::kUsage);
  options.seconds = 0.1;
  options.scene = "no such scene";
  const auto report = run_suite("latency", options);
  ASSERT_FALSE(report.ok());
  EXPECT_THAT(report.error().message(), HasSubstr("no such scene"));
}

}  // namespace
}  // namespace palpate
