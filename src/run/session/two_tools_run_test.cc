#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "loading/test_loading.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/logged_loop.h"
#include "palpate/palpation/palpation.h"
#include "palpate/recording/recorder.h"
#include "palpate/session/playback.h"
#include "palpate/tissue/carving.h"

/// A run of two devices, one with a probe and one with a burr: its recording, and the replay.
namespace palpate {
namespace {

class TwoToolsRun : public ::testing::Test {
 protected:
  void SetUp() override {
    Model with_probe = *loaded_.model;
    with_probe.tools.insert(with_probe.tools.begin(), Tool());
    with_probe.tools[0].name = "hook";
    with_probe.tools[0].radius_mm = 1.5;
    with_probe.tools[0].capsules = {{{0, 0, 0}, {0, 0, 40}, 1}};
    loaded_.model =
        prepared_with_cache(std::make_shared<const Model>(with_probe), std::array{ForceMethod::kProxy})
            .value();
    run();
    RecordingHeader header;
    header.model_hash = loaded_.model->content_hash;
    header.devices = 2;
    auto writer = RecordingWriter::create(folder_ / "run.h5", header);
    ASSERT_TRUE(writer.ok()) << writer.error().message();
    ASSERT_TRUE((*writer)->append(ticks_, events_).ok());
    ASSERT_TRUE((*writer)->finish(summary_).ok());
    auto read = read_recording(folder_ / "run.h5");
    ASSERT_TRUE(read.ok()) << read.error().message();
    recording_ = std::move(*read);
  }

  // both are pressed in and moved along the surface
  void run() {
    std::shared_ptr<const Model> model = loaded_.model;
    Parameters parameters;
    parameters.method = ForceMethod::kProxy;
    parameters.motor = true;
    SessionState state;
    std::array<DeviceState, 2> devices;
    std::array<Wrench, 2> wrenches;
    const auto above = [&](double clear_mm, double turned_rad) {
      const double r = testing::kBoneRadius_mm + clear_mm;
      return model->X_WorldPatient * Point<Patient>(r * std::sin(turned_rad), 0, r * std::cos(turned_rad));
    };
    for (int n = 0; n < 800; ++n) {
      const double in_mm = std::min(4.0, 0.01 * n);
      devices[0].tip = above(3 - in_mm, 0.6);
      devices[1].tip = above(3.5 - in_mm, 1e-4 * n);
      if (n % 20 == 0) model = cut(model, state);
      tick(*model, parameters, devices, 1e-3, state, wrenches, ticks_.emplace_back());
      summary_.observe(ticks_.back());
    }
  }
  // cuts as a session does, recording each sweep
  std::shared_ptr<const Model> cut(const std::shared_ptr<const Model>& model, const SessionState& state) {
    EXPECT_TRUE(finished_cuts(state.device[0].burr, 0).empty());
    const std::vector<Cut> cuts = finished_cuts(state.device[1].burr, 1);
    if (cuts.empty()) return model;
    const auto next = carved_by(*model, cuts)->applied_to(*model);
    for (const Cut& each : cuts) events_.push_back(sweep_event(each, next->version));
    RecordingEvent& version = events_.emplace_back();
    version.number = next->version;
    version.change = {next->version, ModelChange::kCut};
    for (std::size_t row = events_.size() - cuts.size() - 1; row < events_.size(); ++row)
      events_[row].tick = state.tick;
    return next;
  }

  test::TemporaryFolder folder_;
  LoadedScene loaded_ = testing::loaded_burr();
  std::vector<TickRecord> ticks_;
  std::vector<RecordingEvent> events_;
  RecordingSummary summary_;
  Recording recording_;
};

TEST_F(TwoToolsRun, ComesBackFromItsRecording) {
  ASSERT_EQ(recording_.ticks.size(), ticks_.size());
  EXPECT_EQ(recording_.events, events_);
  const auto sweeps =
      std::ranges::count(recording_.events, RecordingEvent::Kind::kSweep, &RecordingEvent::kind);
  EXPECT_GT(sweeps, 5);
  for (const RecordingEvent& event : recording_.events)
    if (event.kind == RecordingEvent::Kind::kSweep) {
      EXPECT_EQ(event.sweep.device, 1u);
      EXPECT_EQ(event.sweep.radius_mm, 2);
    }
  // each device was in contact with the bone by its own tool
  const DeviceTick &probe = recording_.ticks.back().device[0], &burr = recording_.ticks.back().device[1];
  EXPECT_EQ(probe.label, testing::kBone);
  const auto clear_mm = [](const DeviceTick& device) {
    const auto& p = device.proxy_patient_mm;
    return std::hypot(p[0], p[1], p[2]) - testing::kBoneRadius_mm;
  };
  EXPECT_NEAR(clear_mm(probe), 1.5, 0.1);
  EXPECT_LT(clear_mm(burr), 1.7) << "sunk in";
}

TEST_F(TwoToolsRun, ReplaysToTheSameHash) {
  const auto again = replay(recording_, loaded_.model);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
  EXPECT_EQ(again->run_hash, summary_.run_hash);
  EXPECT_EQ(again->ticks, ticks_.size());
  // with the tools exchanged the replay differs
  Model exchanged = *loaded_.model;
  std::swap(exchanged.tools[0], exchanged.tools[1]);
  const auto other = replay(recording_, std::make_shared<const Model>(exchanged));
  ASSERT_TRUE(other.ok()) << other.error().message();
  EXPECT_FALSE(other->identical);
}

TEST_F(TwoToolsRun, ShowsTheToolOfEachDevice) {
  const auto opened = open_playback(RecordingSource(recording_), loaded_.model, Modality::kMr);
  ASSERT_TRUE(opened.ok()) << opened.error().message();
  const ViewedScene scene = (*opened)->scene();
  ASSERT_EQ(scene.tools.size(), 2u);
  EXPECT_EQ(scene.tools[0].name, "hook");
  EXPECT_FALSE(scene.tools[0].cuts);
  EXPECT_EQ(scene.tools[0].capsules.size(), 1u);
  EXPECT_TRUE(scene.tools[1].cuts);
  EXPECT_EQ(scene.tools[1].burr, "ball");
  EXPECT_EQ(scene.tools[1].radius_mm, 2);
  const auto left = remaining_labels(recording_, *loaded_.model);
  ASSERT_TRUE(left.ok()) << left.error().message();
  ASSERT_EQ(left->removed.size(), 1u);
  EXPECT_GT(left->removed[0].volume_mm3, 2);
}

}  // namespace
}  // namespace palpate
