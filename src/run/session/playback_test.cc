#include "palpate/session/playback.h"

#include <gtest/gtest.h>

#include <random>

#include "base/test_folder.h"
#include "base/test_processors.h"
#include "base/test_seed.h"
#include "base/test_wait.h"
#include "loading/test_loading.h"
#include "palpate/palpation/palpation.h"

namespace palpate {
namespace {

using testing::loaded_ball;

constexpr std::size_t kTicks = 10'000;

// three blocks; the clock occasionally skips ticks
Recording counted_recording() {
  Recording recording;
  recording.header.model_hash = loaded_ball().model->content_hash;
  recording.header.clock = "real";
  double time_s = 0.25;
  for (std::size_t i = 0; i < kTicks; ++i) {
    TickRecord& tick = recording.ticks.emplace_back();
    tick.tick = i;
    tick.time_s = time_s;
    time_s += i % 700 == 0 ? 0.004 : 0.001;
    tick.method = static_cast<std::uint8_t>(ForceMethod::kProxy);
    tick.model_version = i < 6000 ? 1 : 2;
    tick.device[0].tip_patient_mm = {static_cast<double>(i), 0, 0};
    tick.device[0].max_stiffness_N_per_mm = 1.0;
    tick.device[0].label = i % 5000 < 1000 ? 0 : testing::kBone;
    tick.state_hash = 7 * i;
  }
  RecordingEvent edit;
  edit.tick = 6000;
  edit.number = 2;
  edit.change = {2, 0, 0.125, 0.3, 0.2, 0};
  recording.events = {edit};
  return recording;
}

std::unique_ptr<PlaybackHost> playback_of(const RecordingSource& source) {
  auto opened = open_playback(source, loaded_ball().model, Modality::kMr);
  EXPECT_TRUE(opened) << opened.error().message();
  return opened ? *std::move(opened) : nullptr;
}

// waits until the block has been read and returns the tick shown
TickRecord shown_when(const ViewerHost& playback, const std::function<bool(const TickRecord&)>& is_there,
                      std::array<double, kMaxDevices>* stiffness = nullptr) {
  std::array<double, kMaxDevices> N_per_mm{};
  TickRecord tick;
  testing::soon([&] {
    tick = playback.snapshot(stiffness ? *stiffness : N_per_mm);
    return is_there(tick);
  });
  return tick;
}

bool is_playing(const ViewerHost& playback) {
  return playback.state().playback->playing;
}

PlayRequest at(double at_s) {
  PlayRequest request;
  request.at_s = at_s;
  return request;
}

TEST(Playback, ShowsTheTickOfEveryPlace) {
  const Recording recording = counted_recording();
  const auto playback = playback_of(recording);
  ASSERT_NE(playback, nullptr);
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::vector<std::size_t> rows = {0, 1, 4095, 4096, 8191, 8192, kTicks - 1};
  for (int i = 0; i < 40; ++i) rows.push_back(random() % kTicks);
  std::ranges::shuffle(rows, random);
  for (const std::size_t row : rows) {
    const TickRecord& record = recording.ticks[row];
    // at its own time and until the time of the next tick
    for (const double later_s : {0.0, 0.0009}) {
      ASSERT_TRUE(playback->play(at(record.time_s + later_s)));
      std::array<double, kMaxDevices> N_per_mm{};
      const TickRecord tick = shown_when(
          *playback, [&](const TickRecord& shown) { return shown.tick == row; }, &N_per_mm);
      ASSERT_EQ(tick.tick, row);
      EXPECT_EQ(tick.time_s, record.time_s);
      EXPECT_EQ(tick.state_hash, record.state_hash);
      EXPECT_EQ(tick.device[0].tip_patient_mm, record.device[0].tip_patient_mm);
      // tissue settings as of that tick, limited by the device's stiffness
      const double own = row < 6000 ? loaded_ball().model->tissues[0].stiffness_N_per_mm : 0.125;
      EXPECT_EQ(playback->state().tissues[0].stiffness_N_per_mm, own);
      EXPECT_EQ(N_per_mm[0], record.device[0].label == 0 ? 0 : std::min(own, 1.0));
    }
  }
  // positions outside the recording are clamped
  ASSERT_TRUE(playback->play(at(-5)));
  EXPECT_EQ(shown_when(*playback, [](const TickRecord& tick) { return tick.tick == 0; }).tick, 0u);
  ASSERT_TRUE(playback->play(at(1e9)));
  EXPECT_EQ(shown_when(*playback, [](const TickRecord& tick) { return tick.tick == kTicks - 1; }).tick,
            kTicks - 1);
}

TEST(Playback, DetectsTheContentsOfAFile) {
  const test::TemporaryFolder folder;
  const LoadedScene ball = loaded_ball();
  const auto simulated = simulate(ball, testing::press_script("ball"), {}, folder / "run.h5");
  ASSERT_TRUE(simulated) << simulated.error().message();
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording) << recording.error().message();
  const auto source = RecordingSource::open(folder / "run.h5");
  ASSERT_TRUE(source) << source.error().message();
  const auto playback = playback_of(*source);
  ASSERT_NE(playback, nullptr);
  EXPECT_EQ(playback->scene().input, "recording");
  EXPECT_EQ(playback->scene().recording->ticks, recording->ticks.size());
  EXPECT_EQ(playback->scene().recording->contacts.size(), 1u);
  for (const std::size_t row : {recording->ticks.size() / 2, std::size_t{0}, recording->ticks.size() - 1}) {
    const TickRecord& record = recording->ticks[row];
    ASSERT_TRUE(playback->play(at(record.time_s)));
    const auto tick =
        shown_when(*playback, [&](const TickRecord& shown) { return shown.tick == record.tick; });
    EXPECT_EQ(tick.device[0].tip_patient_mm, record.device[0].tip_patient_mm);
    EXPECT_EQ(tick.device[0].force_N, record.device[0].force_N);
    EXPECT_EQ(tick.rotation_applied_wxyz, record.rotation_applied_wxyz);
    EXPECT_EQ(tick.state_hash, record.state_hash);
  }
}

TEST(Playback, PlaysToEitherEndAndRestsThere) {
  const Recording recording = counted_recording();
  const auto playback = playback_of(recording);
  ASSERT_NE(playback, nullptr);
  EXPECT_FALSE(is_playing(*playback));
  const auto play = [&](double speed) {
    PlayRequest request;
    request.playing = true;
    request.speed = speed;
    ASSERT_TRUE(playback->play(request));
    EXPECT_EQ(playback->state().playback->speed, speed);
    // the position is monotonic in the direction of playback
    const bool forwards = speed > 0;
    std::array<double, kMaxDevices> N_per_mm{};
    double last_s = playback->snapshot(N_per_mm).time_s;
    bool began = false;
    const TickRecord end = shown_when(*playback, [&](const TickRecord& tick) {
      if (began) {
        EXPECT_TRUE(forwards ? tick.time_s >= last_s : tick.time_s <= last_s);
      }
      began = began || tick.time_s == (forwards ? recording.ticks.front() : recording.ticks.back()).time_s;
      last_s = tick.time_s;
      return !is_playing(*playback) && tick.tick == (forwards ? kTicks - 1 : 0);
    });
    EXPECT_EQ(end.tick, forwards ? kTicks - 1 : 0);
    EXPECT_FALSE(is_playing(*playback));
  };
  play(32);
  play(-32);
  play(32);
  // playback restarts from the beginning when it is at the end
  play(32);
}

TEST(Playback, RestsAtAStop) {
  const Recording recording = counted_recording();
  const auto playback = playback_of(recording);
  ASSERT_NE(playback, nullptr);
  PlayRequest request = at(1);
  request.playing = true;
  request.speed = 0.01;
  ASSERT_TRUE(playback->play(request));
  EXPECT_TRUE(is_playing(*playback));
  playback->emergency_stop({2, false});
  EXPECT_FALSE(is_playing(*playback));
  EXPECT_FALSE(playback->state().stop);
  EXPECT_EQ(playback->live(), nullptr);
}

TEST(Playback, ReportsUnavailableData) {
  const auto refused = [](const Recording& recording) {
    const auto opened = open_playback(recording, loaded_ball().model, Modality::kUnknown);
    return opened ? std::string("opened") : opened.error().message();
  };
  Recording other = counted_recording();
  other.header.model_hash += 1;
  EXPECT_NE(refused(other).find("a different scene"), std::string::npos);
  Recording back = counted_recording();
  back.ticks[500].time_s = 0;
  EXPECT_NE(refused(back).find("does not advance"), std::string::npos);
  Recording empty = counted_recording();
  empty.ticks.clear();
  empty.events.clear();
  EXPECT_NE(refused(empty).find("no ticks"), std::string::npos);
}

TEST(Playback, ReportsThreadCreationFailure) {
  const Recording recording = counted_recording();
  const test::NoThreads none;
  const auto opened = open_playback(recording, loaded_ball().model, Modality::kUnknown);
  ASSERT_FALSE(opened.ok());
  EXPECT_EQ(opened.error().kind, ErrorKind::kUnavailable);
  EXPECT_NE(opened.error().what.find("cannot start a thread"), std::string::npos) << opened.error().message();
}

TEST(Playback, TellsWhereItCannotGoOn) {
  Recording recording = counted_recording();
  const auto playback = playback_of(recording);
  ASSERT_NE(playback, nullptr);
  // the recording changes, as if another process wrote to the file
  for (std::size_t i = 8192; i < kTicks; ++i) recording.ticks[i].time_s += 1;
  ASSERT_TRUE(playback->play(at(9.5)));
  (void)shown_when(*playback,
                   [&](const TickRecord&) { return playback->state().playback->failure.has_value(); });
  ASSERT_TRUE(playback->state().playback->failure);
  EXPECT_NE(playback->state().playback->failure->what.find("the recording changed"), std::string::npos);
  // reading is retried on the next request
  for (std::size_t i = 8192; i < kTicks; ++i) recording.ticks[i].time_s -= 1;
  ASSERT_TRUE(playback->play(at(9.5)));
  const TickRecord there = shown_when(*playback, [](const TickRecord& tick) { return tick.time_s > 9; });
  EXPECT_NEAR(there.time_s, 9.5, 0.01);
  EXPECT_FALSE(playback->state().playback->failure);
}

}  // namespace
}  // namespace palpate
