// A session that is killed: everything up to the last flush remains readable, edits included.

#include <fcntl.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <random>
#include <set>
#include <thread>

#include "base/test_process.h"
#include "base/test_seed.h"
#include "loading/test_loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/recording/recording_source.h"
#include "session/test_edited_session.h"

namespace palpate {
namespace {

// process of edited_session, with the pipe on which it reports each edit
struct Edited {
  /// @param does  "press" or "mill"
  Edited(const std::filesystem::path& file, const char* does) {
    int ends[2];
    PALPATE_CHECK(::pipe2(ends, O_CLOEXEC) == 0);
    id = ::fork();
    if (id == 0) {
      ::dup2(ends[1], STDOUT_FILENO);
      ::execl(PALPATE_EDITED_SESSION, "edited_session", file.c_str(), does, static_cast<char*>(nullptr));
      ::_exit(127);
    }
    ::close(ends[1]);
    declared = ends[0];
  }
  ~Edited() { ::close(declared); }
  bool next_edit() const {
    char byte = 0;
    return ::read(declared, &byte, 1) == 1;
  }
  pid_t id = -1;
  int declared = -1;
};

// checks the recorded edits of the viewers, in order
void expect_edits(const Recording& recording, bool count_askers) {
  std::uint32_t version = recording.header.model_version;
  std::set<std::uint32_t> askers;
  for (const RecordingEvent& event : recording.events) {
    const TickRecord& tick = recording.ticks.at(event.tick);
    ASSERT_EQ(tick.tick, event.tick);
    if (event.by.originator == Originator::kControlViewer) askers.insert(event.by.viewer);
    if (event.kind != RecordingEvent::Kind::kModel) continue;
    EXPECT_EQ(event.number, ++version);
    if (event.change.is_of_tissue()) {
      EXPECT_EQ(event.change.contact.stiffness_N_per_mm, testing::edited_stiffness_N_per_mm(event.by.viewer));
    }
    // effective from this tick on, not earlier
    EXPECT_GE(tick.model_version, version);
    ASSERT_GT(event.tick, 0u);
    EXPECT_LT(recording.ticks[event.tick - 1].model_version, version);
  }
  // sweeps precede the model version that they produced
  std::uint32_t next = recording.header.model_version + 1;
  for (const RecordingEvent& event : recording.events) {
    if (event.kind == RecordingEvent::Kind::kSweep) {
      EXPECT_EQ(event.number, next);
    }
    if (event.kind == RecordingEvent::Kind::kModel) next = event.number + 1;
  }
  if (!recording.ticks.empty()) {
    EXPECT_EQ(recording.ticks.back().model_version, version) << "an edit that was felt is missing";
  }
  // no edit is missing before the last one recorded; a stroke edit may have had nothing to undo
  if (count_askers) {
    EXPECT_EQ(askers.size(), askers.empty() ? 0 : *askers.rbegin());
  }
}

void kill_and_replay(const LoadedScene& loaded, const char* does, int kills, bool count_askers) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  const auto model = prepared_with_cache(loaded.model, std::vector{loaded.scene.force.method});
  ASSERT_TRUE(model.ok()) << model.error().message();
  const test::TemporaryFolder folder;
  std::size_t ticks = 0, events = 0, versions = 0, strokes = 0, sweeps = 0;
  for (int kill = 0; kill < kills; ++kill) {
    SCOPED_TRACE("kill " + std::to_string(kill));
    const auto file = folder / ("run" + std::to_string(kill) + ".h5");
    const Edited session(file, does);
    ASSERT_TRUE(session.next_edit()) << "it never ran";
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 4000));
    // data on disk at this time
    const auto before = RecordingSource::open(file);
    ASSERT_TRUE(before.ok()) << before.error().message();
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 400'000));
    test::kill_between_writes(session.id);

    const auto recording = read_recording(file);
    ASSERT_TRUE(recording.ok()) << recording.error().message();
    EXPECT_FALSE(recording->summary);
    EXPECT_GE(recording->ticks.size(), before->head().ticks);
    ASSERT_NO_FATAL_FAILURE(expect_edits(*recording, count_askers));
    const auto again = replay(*recording, *model);
    ASSERT_TRUE(again.ok()) << again.error().message();
    EXPECT_TRUE(again->identical) << again->difference;
    EXPECT_EQ(again->ticks, recording->ticks.size());
    strokes += static_cast<std::size_t>(std::ranges::count_if(
        recording->events, [](const RecordingEvent& event) { return event.change.is_of_stroke(); }));
    sweeps +=
        static_cast<std::size_t>(std::ranges::count_if(recording->events, [](const RecordingEvent& event) {
          return event.kind == RecordingEvent::Kind::kSweep;
        }));
    ticks += recording->ticks.size();
    events += recording->events.size();
    if (!recording->ticks.empty()) versions += recording->ticks.back().model_version - 1;
    std::filesystem::remove(file);
  }
  std::printf(
      "%d kills: %zu ticks replayed, with %zu events, %zu versions of the model and %zu strokes undone or "
      "done "
      "again among them\n",
      kills, ticks, events, versions, strokes);
  EXPECT_GT(events, 0u);
  EXPECT_GT(versions, 0u);
  EXPECT_EQ(sweeps > 0, loaded.model->has_burr());
}

// the full campaign is PALPATE_TEST_KILLS=50, for each kind
int kills_or(int few) {
  const char* value = std::getenv("PALPATE_TEST_KILLS");
  return value != nullptr ? std::atoi(value) : few;
}

TEST(KilledSession, ReplaysToTheLastFlushWithItsEdits) {
  kill_and_replay(testing::loaded_ball(), "press", kills_or(5), true);
}

TEST(KilledSession, ReplaysToTheLastFlushWithItsCuts) {
  kill_and_replay(testing::loaded_burr(), "mill", kills_or(3), false);
}

TEST(LongRecording, ReplaysInMemoryThatDoesNotGrowWithIt) {
  const LoadedScene loaded = testing::loaded_ball();
  const auto model = prepared_with_cache(loaded.model, std::vector{loaded.scene.force.method});
  ASSERT_TRUE(model.ok()) << model.error().message();
  const test::TemporaryFolder folder;
  const auto peak_MiB = [&](double seconds) {
    const auto script = parse_script(
        "[[step]]\napproach = \"ball\"\n[[step]]\npress = 0.8\n[[step]]\nhold = " + std::to_string(seconds) +
            "\n",
        "script");
    PALPATE_CHECK(script.ok());
    const auto simulated = simulate({loaded.scene, *model, ""}, *script, {}, folder / "run.h5");
    PALPATE_CHECK(simulated.ok());
    const double peak = test::peak_memory_of([&] {
      const auto source = RecordingSource::open(folder / "run.h5");
      const auto again = source ? replay(*source, *model) : source.error();
      return again && again->identical && again->ticks == simulated->summary.ticks;
    });
    EXPECT_GT(peak, 0) << "it did not replay";
    return peak;
  };
  const double once = peak_MiB(10), four_times = peak_MiB(40);
  // the additional 30 000 ticks would occupy 54 MB in memory
  EXPECT_LT(four_times - once, 12) << once << " MiB and " << four_times << " MiB";
}

}  // namespace
}  // namespace palpate
