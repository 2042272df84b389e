#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "base/test_wait.h"
#include "loading/test_loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/session/playback.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/protected_distance.h"
#include "palpate/tissue/removed_volume.h"

/// A scripted hand with a burr: its recording, and the replay.
namespace palpate {
namespace {

using EventKind = RecordingEvent::Kind;

Script milling() {
  return parse_script(
             "[[step]]\nmotor = true\n[[step]]\napproach = \"ball\"\n[[step]]\npress = 1.0\n"
             "[[step]]\nhold = 0.5\n[[step]]\nslide = 3.0\ndirection = \"left\"\n"
             "[[step]]\nmotor = false\n[[step]]\nhold = 0.3\n[[step]]\nleave = true\n",
             "milling script")
      .value();
}

void go_to(PlaybackHost& playback, const TickRecord& tick) {
  PlayRequest request;
  request.at_s = tick.time_s;
  ASSERT_TRUE(playback.play(request).ok());
  testing::soon([&] {
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    return playback.snapshot(stiffness_N_per_mm).tick == tick.tick;
  });
}

bool changes_motor(const RecordingEvent& event) {
  return (event.changed & kSettingMotor) != 0;
}

class BurrRun : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto simulated = simulate(loaded_, milling(), {}, folder_ / "run.h5");
    ASSERT_TRUE(simulated.ok()) << simulated.error().message();
    run_hash_ = simulated->summary.run_hash;
    auto read = read_recording(folder_ / "run.h5");
    ASSERT_TRUE(read.ok()) << read.error().message();
    recording_ = std::move(*read);
  }
  long count(EventKind kind) const {
    return std::ranges::count_if(recording_.events, [&](const auto& event) { return event.kind == kind; });
  }
  RecordingEvent& first(EventKind kind) {
    return *std::ranges::find_if(recording_.events, [&](const auto& event) { return event.kind == kind; });
  }

  test::TemporaryFolder folder_;
  LoadedScene loaded_ = testing::loaded_burr();
  Recording recording_;
  std::uint64_t run_hash_ = 0;
};

TEST(BurrScene, AStepThatFailsSwitchesTheMotorOff) {
  // slides along the surface until the surface ends
  const Script script = parse_script(
                            "[[step]]\napproach = \"ball\"\n[[step]]\nmotor = true\n[[step]]\npress = 1.0\n"
                            "[[step]]\nslide = 200\ndirection = \"left\"\nspeed = 60\n",
                            "failing script")
                            .value();
  const test::TemporaryFolder folder;
  const auto simulated = simulate(testing::loaded_burr(), script, {}, folder / "run.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  ASSERT_EQ(simulated->failed_steps, 1u);
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording.ok()) << recording.error().message();
  EXPECT_EQ(std::ranges::count_if(recording->events, changes_motor), 2);
  EXPECT_EQ(recording->ticks.back().switches & kSwitchMotor, 0u);
}

TEST_F(BurrRun, EveryCutStandsInTheRecording) {
  EXPECT_EQ(std::ranges::count_if(recording_.events, changes_motor), 2);
  EXPECT_GT(count(EventKind::kModel), 20);
  EXPECT_GT(count(EventKind::kSweep), count(EventKind::kModel));
  std::uint32_t version = 1;
  long waiting = 0;
  for (const RecordingEvent& event : recording_.events) {
    if (event.kind == EventKind::kSweep) {
      EXPECT_EQ(event.number, version + 1) << "of the version that comes next";
      EXPECT_EQ(event.sweep.radius_mm, 2);
      ++waiting;
    } else if (event.kind == EventKind::kModel) {
      EXPECT_EQ(event.change.tissue, ModelChange::kCut);
      EXPECT_EQ(event.number, ++version);
      EXPECT_GT(std::exchange(waiting, 0), 0);
    }
  }
  EXPECT_EQ(waiting, 0);
  EXPECT_EQ(recording_.ticks.back().model_version, version);
  // no cut is blended in, and none releases the contact
  for (const TickRecord& tick : recording_.ticks)
    ASSERT_EQ(tick.device[0].flags & (kFlagBlend | kFlagInside), 0u) << tick.tick;
}

TEST_F(BurrRun, ReplaysToTheSameHash) {
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
  EXPECT_EQ(result->run_hash, run_hash_);
}

TEST(BurrScene, AConeIsRecordedReplayedShownAndExported) {
  const test::TemporaryFolder folder;
  LoadedScene loaded = testing::loaded_burr();
  Model model = *loaded.model;
  model.tools[0].burr->length_mm = 5;
  model.tools[0].burr->end_radius_mm = 3;
  loaded.model = std::make_shared<const Model>(std::move(model));
  const auto simulated = simulate(loaded, milling(), {}, folder / "run.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording.ok()) << recording.error().message();
  const auto result = replay(*recording, loaded.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->identical) << result->difference;
  EXPECT_EQ(result->run_hash, simulated->summary.run_hash);
  std::vector<SweepRecord> sweeps;
  RemovedVolume removed(*loaded.model);
  for (const RecordingEvent& event : recording->events)
    if (event.kind == EventKind::kSweep) {
      sweeps.push_back(event.sweep);
      removed.add(std::vector<Cut>{cut_of(event.sweep)});
      EXPECT_NEAR(std::hypot(event.sweep.axis_mm[0], event.sweep.axis_mm[1], event.sweep.axis_mm[2]), 5,
                  1e-9);
      EXPECT_EQ(event.sweep.end_radius_mm, 3);
    }
  ASSERT_GT(sweeps.size(), 3u);
  const auto left = remaining_labels(*recording, *loaded.model);
  ASSERT_TRUE(left.ok()) << left.error().message();
  ASSERT_EQ(left->removed.size(), 1u);
  EXPECT_NEAR(left->removed[0].volume_mm3, removed.by_label_mm3().begin()->second, 1e-6);
  const auto opened = open_playback(RecordingSource(*recording), loaded.model, Modality::kMr);
  ASSERT_TRUE(opened.ok()) << opened.error().message();
  go_to(**opened, recording->ticks.back());
  EXPECT_EQ((*opened)->sweeps((*opened)->state().model_version, 0, sweeps.size() + 5), sweeps);
  const ViewedScene scene = (*opened)->scene();
  EXPECT_EQ(scene.tools[0].burr, "cone");
  ASSERT_EQ(scene.tools[0].capsules.size(), 1u);
  EXPECT_EQ(scene.tools[0].capsules[0].to_mm, (std::array<double, 3>{5, 0, 0}));
  EXPECT_EQ(scene.tools[0].capsules[0].end_radius_mm, 3);
}

TEST_F(BurrRun, ReplaysAsFarAsItWasWritten) {
  const std::size_t all = recording_.ticks.size();
  recording_.summary.reset();
  for (const std::size_t left : {all / 2, all / 3}) {
    recording_.ticks.resize(left);
    std::erase_if(recording_.events, [&](const RecordingEvent& event) { return event.tick >= left; });
    const auto result = replay(recording_, loaded_.model);
    ASSERT_TRUE(result.ok()) << result.error().message();
    EXPECT_TRUE(result->identical) << result->difference;
    EXPECT_EQ(result->ticks, left);
  }
}

TEST_F(BurrRun, AnotherSweepIsAnotherRun) {
  first(EventKind::kSweep).sweep.radius_mm = 3;
  const auto result = replay(recording_, loaded_.model);
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_FALSE(result->identical);
  EXPECT_GE(result->first_difference, first(EventKind::kSweep).tick);
}

TEST_F(BurrRun, RemainingLabelsMatchTheFinalModel) {
  const auto left = remaining_labels(recording_, *loaded_.model);
  ASSERT_TRUE(left.ok()) << left.error().message();
  std::vector<Cut> cuts;
  for (const RecordingEvent& event : recording_.events)
    if (event.kind == EventKind::kSweep) cuts.push_back(cut_of(event.sweep));
  const auto expected = Carving(*loaded_.model).with(cuts)->applied_to(*loaded_.model);
  EXPECT_EQ(left->labels.layers.front().voxels(), expected->labels->dense().voxels());
  EXPECT_NE(left->labels.layers.front().voxels(), loaded_.model->labels->dense().voxels());
  ASSERT_EQ(left->removed.size(), 1u);
  EXPECT_EQ(left->removed[0].structure, "ball");
  // compared with the volume of the removed voxels, which are coarser
  const GridGeometry& grid = loaded_.model->labels->geometry();
  const double voxel_mm3 = grid.spacing_mm.prod();
  const auto count = [&](const Bricks<LabelId>& labels) { return label_counts(labels)[testing::kBone]; };
  const double by_voxels_mm3 =
      voxel_mm3 * static_cast<double>(count(*loaded_.model->labels) - count(*expected->labels));
  EXPECT_GT(by_voxels_mm3, 5);
  EXPECT_NEAR(left->removed[0].volume_mm3 / by_voxels_mm3, 1, 0.1);
  // labels of another scene
  LoadedScene other = loaded_;
  Model model = *other.model;
  model.content_hash = 7;
  EXPECT_FALSE(remaining_labels(recording_, model).ok());
}

TEST_F(BurrRun, SweepsAreRemovedFromEveryOverlappingLayer) {
  // overlapping layers: a region without contact around the ball, a part of the ball, and a structure by
  // threshold
  constexpr LabelId kRegion = 77, kPart = 78;
  const Volume<LabelId> before = loaded_.model->labels->dense();
  LabelMap layers;
  layers.layers.assign(3, Volume<LabelId>(before.geometry()));
  layers.segments = {
      {testing::kBone, "ball", {}, 0, 1}, {kRegion, "region", {}, 1, 1}, {kPart, "part", {}, 2, 1}};
  for (std::size_t v = 0; v < before.voxels().size(); ++v) {
    layers.layers[0].voxels()[v] = before.voxels()[v] == testing::kBone;
    layers.layers[1].voxels()[v] = 1;
    layers.layers[2].voxels()[v] = before.voxels()[v] == testing::kBone && v % 2 == 0;
  }
  Model model = *loaded_.model;
  if (model.tissue_of_label.size() <= kPart) model.tissue_of_label.resize(kPart + 1, -1);
  model.segments = layers.segments;
  model.tissue_of_label[kPart] = model.tissue_of_label[testing::kBone];
  const auto flat = remaining_labels(recording_, model);
  const auto left = remaining_labels(recording_, model, &layers);
  ASSERT_TRUE(flat.ok());
  ASSERT_TRUE(left.ok());
  ASSERT_EQ(left->labels.layers.size(), 3u);
  EXPECT_EQ(left->labels.segments.size(), layers.segments.size());
  std::size_t removed = 0;
  for (std::size_t v = 0; v < before.voxels().size(); ++v) {
    const bool is_gone = before.voxels()[v] != flat->labels.layers[0].voxels()[v];
    removed += is_gone;
    ASSERT_EQ(left->labels.layers[0].voxels()[v], is_gone ? 0 : layers.layers[0].voxels()[v]);
    ASSERT_EQ(left->labels.layers[1].voxels()[v], 1) << "what is not felt is not cut";
    ASSERT_EQ(left->labels.layers[2].voxels()[v], is_gone ? 0 : layers.layers[2].voxels()[v]);
  }
  EXPECT_GT(removed, 100u);
}

TEST_F(BurrRun, PlaybackShowsTheRemovedTissueAtEachPosition) {
  std::vector<SweepRecord> all;
  for (const RecordingEvent& event : recording_.events)
    if (event.kind == EventKind::kSweep) all.push_back(event.sweep);
  const auto opened = open_playback(RecordingSource(recording_), loaded_.model, Modality::kMr);
  ASSERT_TRUE(opened.ok()) << opened.error().message();
  PlaybackHost& playback = **opened;
  // forwards and backwards
  for (const double part : {0.0, 0.6, 1.0, 0.4}) {
    const TickRecord& tick =
        recording_.ticks[static_cast<std::size_t>(part * static_cast<double>(recording_.ticks.size() - 1))];
    go_to(playback, tick);
    const auto lost =
        static_cast<std::uint64_t>(std::ranges::count_if(recording_.events, [&](const auto& event) {
          return event.kind == EventKind::kSweep && event.number <= tick.model_version;
        }));
    EXPECT_EQ(playback.state().sweeps, lost) << part;
    EXPECT_EQ(lost > 0, part > 0.35) << part;
    std::vector<Cut> cuts;
    for (const RecordingEvent& event : recording_.events)
      if (event.kind == EventKind::kSweep && event.number <= tick.model_version)
        cuts.push_back(cut_of(event.sweep));
    RemovedVolume removed(*loaded_.model);
    removed.add(cuts);
    EXPECT_EQ(playback.state().removed_mm3, removed.by_label_mm3()) << part;
    const auto left = Carving(*loaded_.model).with(cuts)->applied_to(*loaded_.model);
    EXPECT_EQ(playback.labels()->dense().voxels(), left->labels->dense().voxels()) << part;
    EXPECT_EQ(removed.by_label_mm3().empty(), lost == 0) << part;
  }
  EXPECT_EQ(playback.sweeps(playback.state().model_version, 0, all.size() + 5), all);
  EXPECT_EQ(playback.sweeps(playback.state().model_version, 3, 2),
            (std::vector<SweepRecord>{all[3], all[4]}));
  EXPECT_TRUE(playback.sweeps(playback.state().model_version, all.size(), 2).empty());
}

TEST(BurrScene, PlaybackTellsHowNearTheBurrHadComeAnywhere) {
  LoadedScene loaded = testing::loaded_burr();
  Model model = *loaded.model;
  for (Tissue& tissue : model.tissues) tissue.protection = Protection::kAlarm;
  loaded.model = std::make_shared<const Model>(std::move(model));
  const test::TemporaryFolder folder;
  const auto simulated = simulate(loaded, milling(), {}, folder / "run.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording.ok()) << recording.error().message();
  constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
  const auto ready = prepared_with_cache(loaded.model, kProxyAlone);
  ASSERT_TRUE(ready.ok());

  const auto opened = open_playback(RecordingSource(*recording), loaded.model, Modality::kMr);
  ASSERT_TRUE(opened.ok()) << opened.error().message();
  ProtectedDistanceMeter meter(**ready);
  auto event = recording->events.begin();
  std::size_t reported = 0, between = 0;
  double before_mm = 1e9;
  for (std::size_t n = 0; n < recording->ticks.size(); ++n) {
    const TickRecord& tick = recording->ticks[n];
    for (; event != recording->events.end() && event->tick <= tick.tick; ++event)
      if (event->kind == EventKind::kSweep) meter.observe(cut_of(event->sweep).sweep);
    meter.observe(tick);
    // sampled throughout the run, and more often during the approach
    const auto nearest = meter.nearest_mm().begin();
    const bool comes_near = nearest != meter.nearest_mm().end() && nearest->second > 0;
    if (n % (recording->ticks.size() / 23) != 0 && !(comes_near && n % 10 == 0)) continue;
    go_to(**opened, tick);
    const std::map<LabelId, double> shown = (*opened)->state().nearest_mm;
    ASSERT_EQ(shown.size(), meter.nearest_mm().size()) << n;
    for (const auto& [label, mm] : meter.nearest_mm()) {
      EXPECT_NEAR(shown.at(label), mm, 0.0101) << n;
      EXPECT_GE(shown.at(label), mm) << n;
      EXPECT_LE(mm, before_mm);
      before_mm = mm;
      ++reported;
      between += mm > 0 ? 1 : 0;
    }
  }
  EXPECT_GT(reported, 10u);
  EXPECT_GT(between, 0u);
  EXPECT_EQ(before_mm, 0);
}

TEST(BurrScene, InLayersItTellsHowNearTheHeadItselfCame) {
  // the outer layer's proxy stays at its own surface while a shell of 2 mm is pressed in
  LoadedScene loaded = testing::loaded_ball(2);
  loaded.scene.force.method = ForceMethod::kProxy;
  Model model = *loaded.model;
  model.tools = testing::loaded_burr().model->tools;
  for (Tissue& tissue : model.tissues)
    tissue.cutting_energy_mJ_per_mm3 = std::numeric_limits<double>::infinity();
  model.tissues[0].protection = Protection::kAlarm;
  // soft enough that the force of the device reaches the bone
  model.tissues[1].stiffness_N_per_mm = 0.3;
  loaded.model = std::make_shared<const Model>(std::move(model));
  const Script script = parse_script(
                            "[[step]]\napproach = \"shell\"\n[[step]]\nmotor = true\n[[step]]\npress = "
                            "1.2\n[[step]]\nhold = 0.2\n[[step]]\nleave = true\n",
                            "leaning script")
                            .value();
  const test::TemporaryFolder folder;
  const auto simulated = simulate(loaded, script, {}, folder / "run.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  EXPECT_EQ(simulated->failed_steps, 0u);
  ASSERT_EQ(simulated->protected_structures.size(), 1u);
  EXPECT_NEAR(simulated->protected_structures[0].nearest_mm.value_or(9), 0, 0.1);
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording.ok()) << recording.error().message();
  const auto opened = open_playback(RecordingSource(*recording), loaded.model, Modality::kMr);
  ASSERT_TRUE(opened.ok()) << opened.error().message();
  go_to(**opened, recording->ticks.back());
  EXPECT_NEAR((*opened)->state().nearest_mm.at(testing::kBone), 0, 0.11);
}

// two strokes at two places; the second is undone, redone and undone
const char* const kTwoStrokes =
    "[[step]]\napproach = \"ball\"\nfrom = \"superior\"\n[[step]]\nmotor = true\n[[step]]\npress = 1.0\n"
    "[[step]]\nhold = 0.3\n[[step]]\nmotor = false\n[[step]]\nleave = true\n"
    "[[step]]\napproach = \"ball\"\nfrom = \"anterior\"\n[[step]]\nmotor = true\n[[step]]\npress = 1.0\n"
    "[[step]]\nhold = 0.3\n[[step]]\nmotor = false\n[[step]]\nleave = true\n"
    "[[step]]\nstroke = \"undo\"\n[[step]]\nstroke = \"redo\"\n[[step]]\nstroke = \"undo\"\n";

TEST(BurrScene, UndoneStrokeIsRestoredInContactViewAndExport) {
  const test::TemporaryFolder folder;
  const LoadedScene loaded = testing::loaded_burr();
  // where the second stroke was, the ball is whole again
  const Script script =
      parse_script(std::string(kTwoStrokes) +
                       "[[step]]\napproach = \"ball\"\nfrom = \"anterior\"\n[[step]]\npress = "
                       "1.0\n[[step]]\nhold = 0.3\n[[step]]\nleave = true\n",
                   "undoing script")
          .value();
  const auto simulated = simulate(loaded, script, {}, folder / "run.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  EXPECT_EQ(simulated->failed_steps, 0u);
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording.ok()) << recording.error().message();

  std::vector<Cut> first;
  std::vector<std::uint32_t> changes;
  std::uint64_t sweeps = 0;
  for (const RecordingEvent& event : recording->events) {
    if (event.kind == EventKind::kSweep) {
      ++sweeps;
      EXPECT_EQ(event.sweep.stroke, changes.empty() && event.sweep.stroke == 1 ? 1u : 2u);
      if (event.sweep.stroke == 1) first.push_back(cut_of(event.sweep));
    }
    if (event.kind != EventKind::kModel || !event.change.is_of_stroke()) continue;
    EXPECT_EQ(event.by.originator, Originator::kScript);
    changes.push_back(event.change.tissue);
  }
  EXPECT_EQ(changes, (std::vector{ModelChange::kUndo, ModelChange::kRedo, ModelChange::kUndo}));
  ASSERT_GT(first.size(), 3u);
  ASSERT_GT(sweeps, first.size() + 3);

  const auto again = replay(*recording, loaded.model);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
  EXPECT_EQ(again->run_hash, simulated->summary.run_hash);

  const auto expected = Carving(*loaded.model).with(first)->applied_to(*loaded.model);
  const auto left = remaining_labels(*recording, *loaded.model);
  ASSERT_TRUE(left.ok()) << left.error().message();
  EXPECT_EQ(left->labels.layers.front().voxels(), expected->labels->dense().voxels());
  RemovedVolume removed(*loaded.model);
  removed.add(first);
  const double gone_mm3 = removed.by_label_mm3().at(testing::kBone);
  ASSERT_EQ(left->removed.size(), 1u);
  EXPECT_EQ(left->removed[0].volume_mm3, gone_mm3);
  ASSERT_EQ(simulated->removed.size(), 1u);
  EXPECT_EQ(simulated->removed[0].volume_mm3, gone_mm3);

  // playback before the undo and after it
  const auto opened = open_playback(RecordingSource(*recording), loaded.model, Modality::kMr);
  ASSERT_TRUE(opened.ok()) << opened.error().message();
  PlaybackHost& playback = **opened;
  const auto undone = std::ranges::find_if(recording->events, [](const RecordingEvent& event) {
    return event.change.tissue == ModelChange::kUndo;
  });
  go_to(playback, recording->ticks[undone->tick - 1]);
  EXPECT_EQ(playback.state().sweeps, sweeps);
  EXPECT_TRUE(playback.state().undone_to.empty());
  EXPECT_GT(playback.state().removed_mm3.at(testing::kBone), gone_mm3);
  go_to(playback, recording->ticks[undone->tick]);
  EXPECT_EQ(playback.state().sweeps, first.size());
  EXPECT_EQ(playback.state().undone_to, std::vector<std::uint64_t>{first.size()});
  EXPECT_EQ(playback.state().removed_mm3.at(testing::kBone), gone_mm3);
  go_to(playback, recording->ticks.back());
  EXPECT_EQ(playback.state().sweeps, first.size());
  ASSERT_EQ(playback.sweeps(playback.state().model_version, 0, 10000).size(), first.size());
  EXPECT_EQ(playback.sweeps(playback.state().model_version, 0, 10000).back(), record_of(first.back()));
}

TEST(BurrScene, ManyEditsReplayToTheSameHash) {
  // the full campaign is PALPATE_TEST_EDITS=2000
  const char* const value = std::getenv("PALPATE_TEST_EDITS");
  const long edits = value != nullptr ? std::atol(value) : 200;
  // consecutive strokes of one second all around the ball; every third is undone
  constexpr long kEditsOfStroke = 65;
  const long strokes = (edits + kEditsOfStroke - 1) / kEditsOfStroke;
  std::string text;
  for (long stroke = 0; stroke < strokes; ++stroke) {
    const double z = 1 - (2 * static_cast<double>(stroke) + 1) / static_cast<double>(strokes),
                 turn = 2.4 * static_cast<double>(stroke), r = std::sqrt(1 - z * z);
    text += "[[step]]\napproach = \"ball\"\nfrom = [" + std::to_string(r * std::cos(turn)) + ", " +
            std::to_string(r * std::sin(turn)) + ", " + std::to_string(z) +
            "]\nspeed = 200\n[[step]]\nmotor = true\n[[step]]\npress = 1.0\n[[step]]\nhold = 1.0\n"
            "[[step]]\nmotor = false\n[[step]]\nleave = true\n";
    if (stroke % 3 == 2) text += "[[step]]\nstroke = \"undo\"\n";
  }
  const test::TemporaryFolder folder;
  const LoadedScene loaded = testing::loaded_burr();
  const auto simulated =
      simulate(loaded, parse_script(text, "script of many strokes").value(), {}, folder / "run.h5");
  ASSERT_TRUE(simulated.ok()) << simulated.error().message();
  EXPECT_EQ(simulated->failed_steps, 0u) << simulated->problems.front();
  const auto recording = RecordingSource::open(folder / "run.h5");
  ASSERT_TRUE(recording.ok()) << recording.error().message();
  const auto again = replay(*recording, loaded.model);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
  EXPECT_EQ(again->run_hash, simulated->summary.run_hash);
  long versions = 0;
  const auto read = recording->read([&](const RecordingPart& part) -> Result<void> {
    versions += std::ranges::count(part.events, EventKind::kModel, &RecordingEvent::kind);
    return {};
  });
  ASSERT_TRUE(read.ok()) << read.error().message();
  std::printf("%ld edits replayed in %llu ticks\n", versions, static_cast<unsigned long long>(again->ticks));
  EXPECT_GE(versions, edits);
}

TEST(BurrScene, AStrokeThatIsNotThereIsAFailedStep) {
  const std::string none = "[[step]]\nstroke = \"undo\"\n";
  const std::string running = "[[step]]\nmotor = true\n[[step]]\nstroke = \"redo\"\n";
  for (const auto& [text, why] : {std::pair{none, "there is no stroke"}, {running, "the motor is running"}}) {
    const auto simulated = simulate(testing::loaded_burr(), parse_script(text, "script").value(), {}, {});
    ASSERT_TRUE(simulated.ok()) << simulated.error().message();
    EXPECT_EQ(simulated->failed_steps, 1u);
    ASSERT_FALSE(simulated->problems.empty());
    EXPECT_NE(simulated->problems.back().find(why), std::string::npos) << simulated->problems.back();
  }
}

TEST(BurrScene, OnlyTheProxyTakesABurr) {
  SimulationOptions trilinear;
  trilinear.method = ForceMethod::kTrilinear;
  const auto refused = simulate(testing::loaded_burr(), milling(), trilinear, {});
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kUsage);
}

}  // namespace
}  // namespace palpate
