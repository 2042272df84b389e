#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <span>

#include "base/test_wait.h"
#include "loading/test_loading.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/palpation.h"
#include "palpate/scene/named_values.h"
#include "palpate/session/explore.h"
#include "palpate/session/playback.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "session/tissue_thread.h"

/// Deforming tissue in runs on the virtual and on the real clock, and their replays.
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

class SolutionRun : public ::testing::Test {
 protected:
  void simulate_it() {
    const auto simulated = simulate(loaded_, palpating(), {}, folder_ / "run.h5");
    ASSERT_TRUE(simulated.ok()) << simulated.error().message();
    EXPECT_THAT(simulated->problems, ::testing::IsEmpty());
    auto read = read_recording(folder_ / "run.h5");
    ASSERT_TRUE(read.ok()) << read.error().message();
    recording_ = *std::move(read);
  }
  std::vector<std::size_t> solutions() const {
    std::vector<std::size_t> indices;
    for (std::size_t n = 0; n < recording_.events.size(); ++n)
      if (recording_.events[n].kind == EventKind::kTissueSolution) indices.push_back(n);
    return indices;
  }

  std::shared_ptr<const Model> ready_model() const {
    constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
    return prepared_with_cache(loaded_.model, kProxyAlone).value();
  }
  // deformation that a live session published with each solution, in order
  std::vector<std::shared_ptr<const ViewedDeformation>> live_deformation(
      const std::function<std::shared_ptr<const Model>(std::uint32_t version)>& model_of) const {
    std::vector<std::shared_ptr<const ViewedDeformation>> live;
    SoftTissueSolver solver;
    for (const std::size_t row : solutions()) {
      const RecordingEvent& event = recording_.events[row];
      const auto tick = std::ranges::lower_bound(recording_.ticks, event.input_tick, {}, &TickRecord::tick);
      solver.solve(*model_of(tick->model_version), *tick);
      live.push_back(viewed_deformation(solver, *tick, 0));
    }
    return live;
  }
  // Seeks to rows of the recording and waits for their deformation. Returns the largest node error divided by
  // the largest displacement there.
  double max_off(PlaybackHost& playback, std::span<const std::shared_ptr<const ViewedDeformation>> live,
                 std::span<const std::size_t> rows) const {
    double worst = 0;
    std::array<double, kMaxDevices> N_per_mm{};
    for (const std::size_t row : rows) {
      const TickRecord& tick = recording_.ticks[row];
      SCOPED_TRACE("row " + std::to_string(row) + ", solution " + std::to_string(tick.solver_frame));
      PlayRequest request;
      request.at_s = tick.time_s;
      EXPECT_TRUE(playback.play(request));
      const ViewedDeformation* const requested =
          tick.solver_frame > 0 ? live[tick.solver_frame - 1].get() : nullptr;
      std::shared_ptr<const ViewedDeformation> shown;
      EXPECT_TRUE(testing::soon([&] {
        const bool is_there = playback.snapshot(N_per_mm).tick == tick.tick;
        shown = playback.deformation(0);
        return is_there && (requested == nullptr ? shown == nullptr
                                                 : shown != nullptr && shown->frame == requested->frame);
      }));
      if (requested == nullptr || shown == nullptr) continue;
      EXPECT_EQ(shown->nodes, requested->nodes);
      EXPECT_EQ(shown->first_patient_mm, requested->first_patient_mm);
      double off_mm = 0, max_mm = 0;
      for (std::size_t n = 0; n < requested->moved_mm.size() && n < shown->moved_mm.size(); ++n) {
        off_mm = std::max(off_mm, static_cast<double>(std::abs(shown->moved_mm[n] - requested->moved_mm[n])));
        max_mm = std::max(max_mm, static_cast<double>(std::abs(requested->moved_mm[n])));
      }
      EXPECT_GT(max_mm, 0);
      EXPECT_LT(off_mm, 0.01 * max_mm);
      worst = std::max(worst, off_mm / max_mm);
    }
    EXPECT_EQ(playback.deformation(kMaxDevices), nullptr);
    return worst;
  }
  // explores the scene and reads the recording; returns the largest displacement that viewers received
  double observed_motion_mm(const LoadedScene& loaded) {
    LiveHost* host = nullptr;
    double moved_mm = 0;
    ExploreOptions options;
    options.loop.realtime = false;
    options.loop.ring_s = 30;
    options.viewers = [&](LiveHost& session) -> Result<std::shared_ptr<void>> {
      host = &session;
      return std::shared_ptr<void>();
    };
    options.request = [&] {
      if (const auto deformation = host->deformation(0)) {
        EXPECT_EQ(deformation->moved_mm.size(),
                  3u * static_cast<std::size_t>(deformation->nodes[0] * deformation->nodes[1] *
                                                deformation->nodes[2]));
        for (const float mm : deformation->moved_mm)
          moved_mm = std::max(moved_mm, static_cast<double>(std::abs(mm)));
      }
      EXPECT_EQ(host->deformation(1), nullptr);
      return ExploreRequest::kNone;
    };
    const auto explored = explore(loaded, palpating(), options, folder_ / "live.h5");
    EXPECT_TRUE(explored.ok());
    if (!explored.ok()) return 0;
    EXPECT_EQ(explored->summary.dropped, 0u);
    auto read = read_recording(folder_ / "live.h5");
    EXPECT_TRUE(read.ok());
    if (read.ok()) recording_ = *std::move(read);
    return moved_mm;
  }
  // rows to seek to: back and forth, adjacent, far apart, and before the first contact
  std::vector<std::size_t> some_rows() const {
    const std::size_t rows = recording_.ticks.size();
    std::vector<std::size_t> some;
    for (const std::size_t percent : {50, 10, 90, 30, 31, 70, 60, 0, 80, 40, 55, 20, 65, 75})
      some.push_back(percent * (rows - 1) / 100);
    for (std::size_t n = 0; n < 6; ++n) some.push_back(rows / 2 + 40 * n);
    return some;
  }

  const test::TemporaryFolder folder_;
  const LoadedScene loaded_ = soft_ball();
  Recording recording_;
};

TEST_F(SolutionRun, HoldsTheRequestedForceOnDeformingTissue) {
  simulate_it();
  double deepest_mm = 0, sustained_N = 0;
  for (const TickRecord& tick : recording_.ticks) {
    deepest_mm = std::max(deepest_mm, tick.device[0].label != 0 ? tick.device[0].depth_mm : 0);
    sustained_N = std::max(sustained_N, tick.device[0].unclamped_force_N);
  }
  EXPECT_GT(sustained_N, 0.5);
  // 8 mm on bone are stiffer than a layer of the scene's 0.75 N/mm would be
  EXPECT_GT(deepest_mm, 1.5);
  EXPECT_LT(deepest_mm, 8);
}

TEST_F(SolutionRun, EverySolutionIsARowAndTheRunReplays) {
  simulate_it();
  const auto rows = solutions();
  const double run_s = recording_.ticks.back().time_s;
  EXPECT_NEAR(static_cast<double>(rows.size()) * kSolverFrame_s / run_s, 1, 0.05);
  for (const std::size_t row : rows) {
    const RecordingEvent& event = recording_.events[row];
    // a solution is used from one frame after its input tick
    EXPECT_EQ(event.tick, event.input_tick + ticks_of_solver_frame(1000) + 1);
  }
  EXPECT_EQ(recording_.ticks.back().solver_frame, rows.size());
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

// the same ball with tissue whose stress relaxes by half
LoadedScene relaxing_ball(TissueLaw law) {
  LoadedScene loaded = soft_ball();
  Model model = *loaded.model;
  model.tissue_law = law;
  model.tissues[1].relaxation = {{{{0.3, 0.2}, {0.2, 3}}}};
  PALPATE_CHECK(model.relaxation_times.add(model.tissues[1].relaxation));
  loaded.model = std::make_shared<const Model>(std::move(model));
  return loaded;
}

class RelaxingRun : public SolutionRun, public ::testing::WithParamInterface<TissueLaw> {};
INSTANTIATE_TEST_SUITE_P(Laws, RelaxingRun, ::testing::Values(TissueLaw::kElastic, TissueLaw::kNeoHookean),
                         [](const auto& law) {
                           return std::string(law.param == TissueLaw::kElastic ? "Elastic" : "NeoHookean");
                         });

TEST_P(RelaxingRun, RelaxationDeepensAHoldAndReplays) {
  const LoadedScene loaded = relaxing_ball(GetParam());
  const auto script = parse_script(
      "[[step]]\napproach = \"shell\"\n[[step]]\npress = 0.4\n[[step]]\nhold = 1.5\n"
      "[[step]]\nslide = 4.0\ndirection = \"left\"\nspeed = 20\n[[step]]\nleave = true\n"
      "[[step]]\napproach = \"shell\"\n[[step]]\npress = 0.3\n[[step]]\nleave = true\n",
      "pressing script");
  ASSERT_TRUE(script.ok()) << script.error().message();
  const auto simulated = simulate(loaded, *script, {}, folder_ / "held.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  EXPECT_THAT(simulated->problems, ::testing::IsEmpty());
  auto read = read_recording(folder_ / "held.h5");
  ASSERT_TRUE(read.ok()) << read.error().message();
  recording_ = *std::move(read);
  EXPECT_GT(solutions().size(), 30u);
  for (const TickRecord& tick : recording_.ticks)
    ASSERT_EQ(tick.device[0].flags & kFlagNotFinite, 0u) << tick.tick;
  // held with the same force, 0.3 s after the press and at the end of the hold
  const auto pressed = std::ranges::find_if(
      recording_.ticks, [](const TickRecord& tick) { return tick.device[0].unclamped_force_N > 0.38; });
  ASSERT_GT(recording_.ticks.end() - pressed, 1500);
  const DeviceTick &early = (pressed + 300)->device[0], &late = (pressed + 1400)->device[0];
  EXPECT_NEAR(late.unclamped_force_N / early.unclamped_force_N, 1, 0.1);
  EXPECT_GT(late.depth_mm, 1.05 * early.depth_mm);
  const auto result = replay(recording_, loaded.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
  // another relaxation series gives another run
  Model other = *loaded.model;
  other.tissues[1].relaxation.term[0].fraction = 0.31;
  const auto different = replay(recording_, std::make_shared<const Model>(std::move(other)));
  ASSERT_TRUE(different.ok()) << different.error().message();
  EXPECT_FALSE(different->identical);
}

TEST_F(SolutionRun, ChainMailForcesEqualLayersBitForBit) {
  std::vector<std::uint64_t> hashes[2];
  for (const TissueLaw law : {TissueLaw::kChainMail, TissueLaw::kLayers}) {
    const auto simulated = simulate(soft_ball(law), palpating(), {}, folder_ / "run.h5");
    ASSERT_TRUE(simulated.ok()) << simulated.error().message();
    auto read = read_recording(folder_ / "run.h5");
    ASSERT_TRUE(read.ok()) << read.error().message();
    recording_ = *std::move(read);
    EXPECT_TRUE(solutions().empty());
    for (const TickRecord& tick : recording_.ticks)
      hashes[law == TissueLaw::kLayers].push_back(tick.state_hash);
    std::filesystem::remove(folder_ / "run.h5");
  }
  EXPECT_GT(hashes[0].size(), 1000u);
  EXPECT_EQ(hashes[0], hashes[1]);
}

// the same ball, milled through its tissue down to the bone
LoadedScene soft_ball_and_burr() {
  LoadedScene loaded = soft_ball();
  Model model = *loaded.model;
  model.tools[0].radius_mm = 2;
  model.tools[0].burr = BurrSettings{.spindle = Eigen::Vector3d(1, 0, 0)};
  model.tissues[1].cutting_energy_mJ_per_mm3 = 20;
  loaded.model = std::make_shared<const Model>(std::move(model));
  return loaded;
}

TEST_F(SolutionRun, ABurrInTissueThatYieldsIsHeldByItsLimitsAndTheRunReplays) {
  const LoadedScene loaded = soft_ball_and_burr();
  const auto script = parse_script(
      "[[step]]\napproach = \"shell\"\n[[step]]\nmotor = true\n[[step]]\npress = 0.5\n"
      "[[step]]\nhold = 0.6\n[[step]]\nmotor = false\n[[step]]\nstroke = \"undo\"\n"
      "[[step]]\nhold = 0.2\n[[step]]\nleave = true\n",
      "cutting script");
  ASSERT_TRUE(script.ok()) << script.error().message();
  const auto simulated = simulate(loaded, *script, {}, folder_ / "cut.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  auto read = read_recording(folder_ / "cut.h5");
  ASSERT_TRUE(read.ok()) << read.error().message();
  recording_ = *std::move(read);
  std::size_t sweeps = 0;
  for (const RecordingEvent& event : recording_.events) sweeps += event.kind == EventKind::kSweep;
  EXPECT_GT(sweeps, 5u);
  EXPECT_GT(solutions().size(), 30u);
  for (const TickRecord& tick : recording_.ticks) {
    const DeviceTick& device = tick.device[0];
    const Eigen::Vector3d force(device.force_N[0], device.force_N[1], device.force_N[2]);
    ASSERT_TRUE(force.allFinite()) << tick.tick;
    ASSERT_LE(force.norm(), tick.max_force_N * (1 + 1e-9)) << tick.tick;
    ASSERT_EQ(device.flags & kFlagNotFinite, 0u) << tick.tick;
  }
  const auto result = replay(recording_, loaded.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

TEST_F(SolutionRun, ANeoHookeanRunIsAnotherOneAndReplaysToo) {
  simulate_it();
  const LoadedScene finite = soft_ball(TissueLaw::kNeoHookean);
  ASSERT_TRUE(simulate(finite, palpating(), {}, folder_ / "finite.h5").ok());
  const auto read = read_recording(folder_ / "finite.h5");
  ASSERT_TRUE(read.ok()) << read.error().message();
  const auto frame_hash = [](const Recording& recording) {
    std::uint64_t last = 0;
    for (const RecordingEvent& event : recording.events)
      if (event.kind == EventKind::kTissueSolution) last = event.frame_hash;
    return last;
  };
  EXPECT_NE(frame_hash(*read), frame_hash(recording_));
  const auto result = replay(*read, finite.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

// the scene's law, then the other elastic law while the tool presses, and back
TEST_F(SolutionRun, AScriptChangesTheLawUnderTheToolAndTheRunReplays) {
  const Script changing =
      parse_script(
          "[[step]]\napproach = \"shell\"\n[[step]]\npress = 0.8\n[[step]]\nhold = 0.4\n"
          "[[step]]\nlaw = \"neo-hookean\"\n[[step]]\nhold = 0.4\n[[step]]\nlaw = \"elastic\"\n"
          "[[step]]\nhold = 0.4\n[[step]]\nleave = true\n",
          "changing script")
          .value();
  const auto simulated = simulate(loaded_, changing, {}, folder_ / "run.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  EXPECT_THAT(simulated->problems, ::testing::IsEmpty());
  recording_ = read_recording(folder_ / "run.h5").value();
  std::vector<TissueLaw> laws;
  for (const RecordingEvent& event : recording_.events)
    if (event.kind == EventKind::kModel) laws.push_back(law_of(event.change));
  EXPECT_THAT(laws, ::testing::ElementsAre(TissueLaw::kNeoHookean, TissueLaw::kElastic));

  // the force changes over more than one tick
  const std::vector<TickRecord>& ticks = recording_.ticks;
  const auto force_N = [](const TickRecord& tick) {
    return Eigen::Map<const Eigen::Vector3d>(tick.device[0].force_N.data()).norm();
  };
  constexpr std::size_t kBlending = 200;
  double changing_N = 0;
  std::array<double, 3> compliance_mm_per_N{};  // compliance after each law was held for a while; mm/N
  for (std::size_t n = 1; n < ticks.size(); ++n) {
    const double step_N = std::abs(force_N(ticks[n]) - force_N(ticks[n - 1]));
    const bool is_changing = n > kBlending && ticks[n].model_version != ticks[n - kBlending].model_version;
    if (is_changing) changing_N = std::max(changing_N, step_N);
    if (ticks[n].device[0].label != 0 && ticks[n].model_version <= 3 && force_N(ticks[n]) > 0.6)
      compliance_mm_per_N[ticks[n].model_version - 1] = ticks[n].device[0].depth_mm / force_N(ticks[n]);
  }
  EXPECT_LT(changing_N, 0.04);
  EXPECT_LT(compliance_mm_per_N[1], 0.995 * compliance_mm_per_N[0]) << "squeezed onto the bone it is stiffer";

  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

// from layers to an elastic law, to a chain mail, and back
TEST_F(SolutionRun, ScriptEnablesDeformationDuringContactAndReplays) {
  const LoadedScene layers = soft_ball(TissueLaw::kLayers);
  const Script changing =
      parse_script(
          "[[step]]\napproach = \"shell\"\n[[step]]\npress = 0.5\n[[step]]\nhold = 0.2\n"
          "[[step]]\nlaw = \"elastic\"\n[[step]]\nhold = 0.4\n[[step]]\nlaw = \"chainmail\"\n"
          "[[step]]\nhold = 0.2\n[[step]]\nlaw = \"neo-hookean\"\n[[step]]\nhold = 0.4\n"
          "[[step]]\nlaw = \"layers\"\n[[step]]\nhold = 0.2\n[[step]]\nleave = true\n",
          "changing script")
          .value();
  const auto simulated = simulate(layers, changing, {}, folder_ / "run.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  EXPECT_THAT(simulated->problems, ::testing::IsEmpty());
  recording_ = read_recording(folder_ / "run.h5").value();
  LawHistory laws(TissueLaw::kLayers);
  for (const RecordingEvent& event : recording_.events)
    if (event.kind == EventKind::kModel) laws.on_event(event.change);
  const std::vector<TickRecord>& ticks = recording_.ticks;
  EXPECT_EQ(ticks.back().model_version, 5u);
  EXPECT_EQ(laws.at(4), TissueLaw::kNeoHookean);
  const auto force_N = [](const TickRecord& tick) {
    return Eigen::Map<const Eigen::Vector3d>(tick.device[0].force_N.data()).norm();
  };
  double step_N = 0;
  for (std::size_t n = 1; n < ticks.size(); ++n) {
    // when tissue stiffens under the tool, the hand is pushed out and the passivity controller dissipates
    // that energy
    if (is_elastic(laws.at(ticks[n].model_version)))
      step_N = std::max(step_N, std::abs(force_N(ticks[n]) - force_N(ticks[n - 1])));
    EXPECT_EQ(ticks[n].device[0].flags & kFlagInside, 0u);
  }
  EXPECT_LT(step_N, 0.06);

  const auto result = replay(recording_, layers.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;

  // in playback, tissue deforms exactly where it did in the run
  const auto playback = open_playback(recording_, layers.model, Modality::kUnknown);
  ASSERT_TRUE(playback.ok()) << playback.error().message();
  EXPECT_THAT((*playback)->scene().laws, ::testing::Contains("neo-hookean"));
  std::array<double, kMaxDevices> N_per_mm{};
  for (std::uint32_t version = 1; version <= 5; ++version) {
    SCOPED_TRACE("version " + std::to_string(version));
    const auto last = std::ranges::find_if(ticks, [&](const TickRecord& tick) {
      return tick.model_version == version && force_N(tick) > 0.4 && tick.time_s > ticks.front().time_s &&
             (version == 1 ||
              tick.time_s > std::ranges::find(ticks, version, &TickRecord::model_version)->time_s + 0.15);
    });
    ASSERT_NE(last, ticks.end());
    PlayRequest request;
    request.at_s = last->time_s;
    ASSERT_TRUE((*playback)->play(request));
    const bool is_deformable = is_elastic(laws.at(version));
    EXPECT_TRUE(testing::soon([&] {
      const bool is_there = (*playback)->snapshot(N_per_mm).tick == last->tick;
      const auto shown = (*playback)->deformation(0);
      return is_there &&
             (is_deformable ? shown != nullptr && shown->frame == last->solver_frame : shown == nullptr);
    }));
    EXPECT_EQ((*playback)->state().law, name_of(laws.at(version), kTissueLaws));
  }
}

TEST_F(SolutionRun, RejectsAScriptThatCannotChangeTheLaw) {
  const auto error_of = [&](const LoadedScene& loaded, const std::string& law) {
    const Script script = parse_script("[[step]]\nlaw = \"" + law + "\"\n", "changing script").value();
    const auto simulated = simulate(loaded, script, {}, folder_ / "none.h5");
    return simulated.ok() ? "" : simulated.error().message();
  };
  EXPECT_THAT(error_of(testing::loaded_ball(), "chainmail"), HasSubstr("has a Young's modulus"));
  EXPECT_THAT(error_of(testing::loaded_ball(), "elastic"), HasSubstr("changing script:1"));
  LoadedScene cut = testing::loaded_burr();
  Model soft = *cut.model;
  soft.tissues[1].elastic = ElasticConstants{20, 0.45};
  cut.model = std::make_shared<const Model>(std::move(soft));
  EXPECT_THAT(error_of(cut, "chainmail"), HasSubstr("cannot start to move"));
  EXPECT_THAT(error_of(cut, "elastic"), HasSubstr("a cutting tool"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none.h5"));
}

TEST_F(SolutionRun, OnTheRealClockAScriptChangesTheLawAndTheRunReplays) {
  const Script changing =
      parse_script(
          "[[step]]\napproach = \"shell\"\n[[step]]\npress = 0.6\n[[step]]\nhold = 0.3\n"
          "[[step]]\nlaw = \"neo-hookean\"\n[[step]]\nhold = 0.3\n[[step]]\nlaw = \"layers\"\n"
          "[[step]]\nhold = 0.2\n[[step]]\nlaw = \"elastic\"\n[[step]]\nhold = 0.3\n[[step]]\nleave = true\n",
          "changing script")
          .value();
  ExploreOptions options;
  options.loop.realtime = false;
  options.loop.ring_s = 30;
  const auto explored = explore(loaded_, changing, options, folder_ / "live.h5");
  ASSERT_TRUE(explored.ok()) << explored.error().message();
  recording_ = read_recording(folder_ / "live.h5").value();
  std::vector<TissueLaw> laws;
  for (const RecordingEvent& event : recording_.events)
    if (event.kind == EventKind::kModel) laws.push_back(law_of(event.change));
  EXPECT_THAT(laws, ::testing::ElementsAre(TissueLaw::kNeoHookean, TissueLaw::kLayers, TissueLaw::kElastic));
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

TEST_F(SolutionRun, ViewerSelectsChainMailInALayerScene) {
  const LoadedScene layers = soft_ball(TissueLaw::kLayers);
  LiveHost* host = nullptr;
  bool requested = false, seen = false, observed_before = false;
  ExploreOptions options;
  options.loop.realtime = false;
  options.loop.ring_s = 30;
  options.viewers = [&](LiveHost& session) -> Result<std::shared_ptr<void>> {
    host = &session;
    return std::shared_ptr<void>();
  };
  options.request = [&] {
    const bool moved = host->deformation(0) != nullptr;
    (requested ? seen : observed_before) |= moved;
    if (!std::exchange(requested, true)) {
      EXPECT_THAT(host->scene().laws,
                  ::testing::ElementsAre("elastic", "neo-hookean", "exponential", "chainmail", "layers"));
      EXPECT_EQ(host->state().law, "layers");
      SettingsRequest request;
      request.law = "rubber";
      EXPECT_EQ(host->set(request).error().where, "law");
      request.law = "chainmail";
      EXPECT_EQ(host->set(request).value(), RequestOutcome::kDone);
      EXPECT_EQ(host->state().law, "chainmail");
    }
    return ExploreRequest::kNone;
  };
  const auto explored = explore(layers, palpating(), options, folder_ / "live.h5");
  ASSERT_TRUE(explored.ok()) << explored.error().message();
  EXPECT_FALSE(observed_before);
  EXPECT_TRUE(seen);
  recording_ = read_recording(folder_ / "live.h5").value();
  const auto result = replay(recording_, layers.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

TEST_F(SolutionRun, AReplayNamesASolutionThatIsAnotherOneOrMissing) {
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
  EXPECT_THAT(result.error().message(), HasSubstr("a tick that is missing"));
}

TEST_F(SolutionRun, OnTheRealClockAThreadSolvesItAndTheRunReplays) {
  // as on a machine too slow for the scene's own cell size; the replay knows the factor from the recording
  LoadedScene slow = loaded_;
  Model coarser = *loaded_.model;
  coarser.tissue_cell_factor = 1.25;
  slow.model = std::make_shared<const Model>(std::move(coarser));
  const double moved_mm = observed_motion_mm(slow);
  EXPECT_GT(moved_mm, 0.5);
  EXPECT_LT(moved_mm, 8);
  EXPECT_GT(solutions().size(), 20u);
  EXPECT_EQ(recording_.header.tissue_cell_factor, 1.25);
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

TEST_F(SolutionRun, ChainMailIsShownAndNotRecordedOnTheRealClock) {
  const LoadedScene mail = soft_ball(TissueLaw::kChainMail);
  const double moved_mm = observed_motion_mm(mail);
  // 0.8 mm deep, and viewers receive every second node
  EXPECT_GT(moved_mm, 0.2);
  EXPECT_LT(moved_mm, 2);
  EXPECT_TRUE(solutions().empty());
  const auto result = replay(recording_, mail.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
}

TEST_F(SolutionRun, PlaybackDeformationEqualsTheRun) {
  simulate_it();
  const auto model = ready_model();
  const auto live = live_deformation([&](std::uint32_t) { return model; });
  EXPECT_GT(std::ranges::count_if(live, [](const auto& deformation) { return deformation != nullptr; }), 40);
  const auto opened = open_playback(recording_, loaded_.model, Modality::kUnknown);
  ASSERT_TRUE(opened) << opened.error().message();
  RecordProperty("max_off", std::to_string(max_off(**opened, live, some_rows())));
}

TEST_F(SolutionRun, PlaybackAfterACutUsesTheRemainingTissue) {
  simulate_it();
  // synthetic cut: beside the tool in the middle of the run, undone near its end
  const std::size_t half = recording_.ticks.size() / 2, late = 9 * recording_.ticks.size() / 10;
  const auto& point = recording_.ticks[half].device[0].contact_patient_mm;
  RecordingEvent sweep, cut, undo;
  sweep.kind = EventKind::kSweep;
  sweep.tick = cut.tick = recording_.ticks[half].tick;
  sweep.number = cut.number = cut.change.version = 2;
  sweep.sweep.from_mm = {point[0], point[1] + 8, point[2] - 2};
  sweep.sweep.to_mm = {point[0] + 1, point[1] + 8, point[2] - 2};
  sweep.sweep.radius_mm = 3;
  cut.change.tissue = ModelChange::kCut;
  undo.tick = recording_.ticks[late].tick;
  undo.number = undo.change.version = 3;
  undo.change.tissue = ModelChange::kUndo;
  for (std::size_t n = half; n < recording_.ticks.size(); ++n)
    recording_.ticks[n].model_version = n < late ? 2 : 3;
  for (const RecordingEvent& event : {sweep, cut, undo})
    recording_.events.insert(
        std::ranges::upper_bound(recording_.events, event.tick, {}, &RecordingEvent::tick), event);

  const auto whole = ready_model();
  const Cut cuts[] = {cut_of(sweep.sweep)};
  const auto less = next_version({whole, whole}, cut.change, cuts);
  ASSERT_TRUE(less) << less.error().message();
  const auto live =
      live_deformation([&](std::uint32_t version) { return version == 2 ? less->current : whole; });
  const auto uncut = live_deformation([&](std::uint32_t) { return whole; });
  const auto opened = open_playback(recording_, loaded_.model, Modality::kUnknown);
  ASSERT_TRUE(opened) << opened.error().message();
  const std::vector<std::size_t> rows{half + 200, half - 100, half + 400, late + 60, half + 210};
  RecordProperty("max_off", std::to_string(max_off(**opened, live, rows)));
  // the deformation shows the cut
  const std::uint32_t frame = recording_.ticks[half + 200].solver_frame;
  EXPECT_NE(live[frame - 1]->moved_mm, uncut[frame - 1]->moved_mm);
}

TEST_F(SolutionRun, PlaybackAdvancesFromSolutionToSolution) {
  simulate_it();
  const auto opened = open_playback(recording_, loaded_.model, Modality::kUnknown);
  ASSERT_TRUE(opened) << opened.error().message();
  PlaybackHost& playback = **opened;
  std::array<double, kMaxDevices> N_per_mm{};
  // slow, so that a busy machine keeps up: a quarter of a second of the run takes five
  for (const double speed : {0.05, -0.05}) {
    PlayRequest request;
    request.at_s = recording_.ticks[recording_.ticks.size() / 2].time_s;
    request.playing = true;
    request.speed = speed;
    ASSERT_TRUE(playback.play(request));
    std::uint32_t last = 0, others = 0;
    EXPECT_TRUE(testing::soon([&] {
      const std::uint32_t number = playback.snapshot(N_per_mm).solver_frame;
      const auto shown = playback.deformation(0);
      if (shown != nullptr) {
        // the deformation shown is at most a quarter of a second old
        EXPECT_LE(std::max(number, shown->frame) - std::min(number, shown->frame), 16u);
        others += shown->frame != last;
        last = shown->frame;
      }
      return others > 2 || !playback.state().playback->playing;
    }));
    EXPECT_GT(others, 2u);
  }
}

TEST_F(SolutionRun, ARecordingThatTellsOfOtherSolutionsIsShownAtRest) {
  simulate_it();
  const std::size_t row = recording_.ticks.size() / 2;
  for (RecordingEvent& event : recording_.events)
    if (event.kind == EventKind::kTissueSolution) event.input_tick = ~std::uint64_t{0};
  const auto opened = open_playback(recording_, loaded_.model, Modality::kUnknown);
  ASSERT_TRUE(opened) << opened.error().message();
  PlayRequest request;
  request.at_s = recording_.ticks[row].time_s;
  ASSERT_TRUE((*opened)->play(request));
  std::array<double, kMaxDevices> N_per_mm{};
  EXPECT_TRUE(
      testing::soon([&] { return (*opened)->snapshot(N_per_mm).tick == recording_.ticks[row].tick; }));
  EXPECT_EQ((*opened)->deformation(0), nullptr);
}

TEST_F(SolutionRun, ReplaysWithAnotherMethod) {
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
