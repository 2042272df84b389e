#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "loading/test_loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/session/explore.h"
#include "palpate/tissue/yield_solver.h"

/// Tissue that yields, in runs on the virtual and on the real clock, and the same again.
namespace palpate {
namespace {

using EventKind = RecordingEvent::Kind;
using ::testing::HasSubstr;

// the ball of bone in 8 mm of tissue of 20 kPa, pressed by a sphere
LoadedScene soft_ball(TissueLaw law = TissueLaw::kElastic) {
  Model model = testing::ball_model({1, 1, 1}, 1.0, 8);
  model.title = "soft ball";
  model.content_hash = 43;
  model.tissue_law = law;
  model.tissues[1].elastic = ElasticConstants{20, 0.45};
  model.tools[0].radius_mm = 3;
  Scene scene;
  scene.force.method = ForceMethod::kProxy;
  return {std::move(scene), std::make_shared<const Model>(std::move(model)), ""};
}

Script palpating() {
  return parse_script(
             "[[step]]\napproach = \"shell\"\n[[step]]\npress = 0.6\n[[step]]\nhold = 0.5\n"
             "[[step]]\nslide = 6.0\ndirection = \"left\"\nspeed = 20\n[[step]]\nleave = true\n",
             "palpating script")
      .value();
}

class YieldRun : public ::testing::Test {
 protected:
  void simulate_it() {
    const auto simulated = simulate(loaded_, palpating(), {}, folder_ / "run.h5");
    ASSERT_TRUE(simulated.ok()) << simulated.error().message();
    EXPECT_THAT(simulated->trouble, ::testing::IsEmpty());
    auto read = read_recording(folder_ / "run.h5");
    ASSERT_TRUE(read.ok()) << read.error().message();
    recording_ = *std::move(read);
  }
  std::vector<std::size_t> solutions() const {
    std::vector<std::size_t> places;
    for (std::size_t n = 0; n < recording_.events.size(); ++n)
      if (recording_.events[n].kind == EventKind::kYield) places.push_back(n);
    return places;
  }

  const test::TemporaryFolder folder_;
  const LoadedScene loaded_ = soft_ball();
  Recording recording_;
};

TEST_F(YieldRun, AHandHoldsWhatItWasAskedForAndTheTissueGivesWay) {
  simulate_it();
  double deepest_mm = 0, held_N = 0;
  for (const TickRecord& tick : recording_.ticks) {
    deepest_mm = std::max(deepest_mm, tick.device[0].label != 0 ? tick.device[0].depth_mm : 0);
    held_N = std::max(held_N, tick.device[0].unclamped_force_N);
  }
  EXPECT_GT(held_N, 0.5);
  // 8 mm on bone give more than a layer of the scene's stiffness, 0.75 N/mm, would
  EXPECT_GT(deepest_mm, 1.5);
  EXPECT_LT(deepest_mm, 8);
}

TEST_F(YieldRun, EverySolutionIsARowAndTheRunReplays) {
  simulate_it();
  const auto rows = solutions();
  const double run_s = recording_.ticks.back().time_s;
  EXPECT_NEAR(static_cast<double>(rows.size()) * kYieldFrame_s / run_s, 1, 0.05);
  for (const std::size_t row : rows) {
    const RecordingEvent& event = recording_.events[row];
    // it comes to the ticks a frame after the one that it was solved from
    EXPECT_EQ(event.tick, event.input_tick + ticks_of_yield_frame(1000) + 1);
  }
  EXPECT_EQ(recording_.ticks.back().yield_frame, rows.size());
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

TEST_F(YieldRun, ANeoHookeanRunIsAnotherOneAndReplaysToo) {
  simulate_it();
  const LoadedScene finite = soft_ball(TissueLaw::kNeoHookean);
  ASSERT_TRUE(simulate(finite, palpating(), {}, folder_ / "finite.h5").ok());
  const auto read = read_recording(folder_ / "finite.h5");
  ASSERT_TRUE(read.ok()) << read.error().message();
  const auto frame_hash = [](const Recording& recording) {
    std::uint64_t last = 0;
    for (const RecordingEvent& event : recording.events)
      if (event.kind == EventKind::kYield) last = event.frame_hash;
    return last;
  };
  EXPECT_NE(frame_hash(*read), frame_hash(recording_));
  const auto result = replay(*read, finite.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

TEST_F(YieldRun, AReplayNamesASolutionThatIsAnotherOneOrMissing) {
  simulate_it();
  const auto rows = solutions();
  Recording other = recording_;
  other.events[rows[50]].frame_hash ^= 1;
  auto result = replay(other, loaded_.model);
  ASSERT_TRUE(result.ok());
  EXPECT_FALSE(result->identical);
  EXPECT_THAT(result->difference, HasSubstr("the tissue's solution 51 "));

  other = recording_;
  other.events.erase(other.events.begin() + static_cast<std::ptrdiff_t>(rows[50]));
  result = replay(other, loaded_.model);
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(result.error().message(), HasSubstr("solution"));

  other = recording_;
  other.events[rows[50]].input_tick = ~std::uint64_t{0};
  result = replay(other, loaded_.model);
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(result.error().message(), HasSubstr("a tick that is not there"));
}

TEST_F(YieldRun, OnTheRealClockAThreadSolvesItAndTheRunReplays) {
  ViewerHost* host = nullptr;
  double moved_mm = 0;
  ExploreOptions options;
  options.loop.realtime = false;
  options.loop.ring_s = 30;
  options.viewers = [&](ViewerHost& session) -> Result<std::shared_ptr<void>> {
    host = &session;
    return std::shared_ptr<void>();
  };
  options.request = [&] {
    if (const auto yielded = host->yielded(0)) {
      EXPECT_EQ(yielded->moved_mm.size(),
                3u * static_cast<std::size_t>(yielded->nodes[0] * yielded->nodes[1] * yielded->nodes[2]));
      for (const float mm : yielded->moved_mm)
        moved_mm = std::max(moved_mm, static_cast<double>(std::abs(mm)));
    }
    EXPECT_EQ(host->yielded(1), nullptr);
    return ExploreRequest::kNone;
  };
  const auto explored = explore(loaded_, palpating(), options, folder_ / "live.h5");
  ASSERT_TRUE(explored.ok()) << explored.error().message();
  EXPECT_EQ(explored->summary.dropped, 0u);
  EXPECT_GT(moved_mm, 0.5);
  EXPECT_LT(moved_mm, 8);
  auto read = read_recording(folder_ / "live.h5");
  ASSERT_TRUE(read.ok()) << read.error().message();
  recording_ = *std::move(read);
  EXPECT_GT(solutions().size(), 20u);
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

TEST_F(YieldRun, FeltByAnotherMethodItReplaysToo) {
  const Script script =
      parse_script("[[step]]\napproach = \"shell\"\n[[step]]\npress = 0.3\n[[step]]\nhold = 0.2\n",
                   "trilinear")
          .value();
  ExploreOptions options;
  options.run.method = ForceMethod::kTrilinear;
  options.loop.realtime = false;
  options.loop.ring_s = 30;
  ASSERT_TRUE(explore(loaded_, script, options, folder_ / "live.h5").ok());
  ASSERT_TRUE(simulate(loaded_, script, options.run, folder_ / "run.h5").ok());
  for (const char* file : {"live.h5", "run.h5"}) {
    const auto read = read_recording(folder_ / file);
    ASSERT_TRUE(read.ok()) << read.error().message();
    const auto result = replay(*read, loaded_.model);
    ASSERT_TRUE(result.ok()) << result.error().message();
    EXPECT_TRUE(result->identical) << file << ": " << result->difference;
  }
}

}  // namespace
}  // namespace palpate
