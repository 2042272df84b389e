// Transfer of a run's ticks from the ring to the disk.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <iterator>
#include <map>
#include <random>
#include <semaphore>
#include <set>
#include <thread>

#include "palpate/base/spsc_ring.h"
#include "recording/recording_file.h"
#include "recording/test_support.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr double kRecorderRate = 1000;
const std::vector<std::string> kFailure{"line 3: asked for 2.00 N, felt 1.40 N"};

// a producer that waits for free slots, so that no tick is dropped
void push_all(SpscRing<TickRecord>& ring, std::span<const TickRecord> ticks) {
  for (const TickRecord& tick : ticks)
    while (!ring.push(tick)) std::this_thread::yield();
}

RecordingSummary summary_of(std::span<const TickRecord> ticks) {
  RecordingSummary summary;
  for (const TickRecord& tick : ticks) summary.observe(tick);
  return summary;
}

void expect_beginning(const std::vector<TickRecord>& read, const std::vector<TickRecord>& pushed) {
  ASSERT_LE(read.size(), pushed.size());
  for (std::size_t i = 0; i < read.size(); ++i)
    ASSERT_EQ(test::first_difference(read[i], pushed[i]), "") << "tick " << i;
}

TEST(Recorder, TakesEveryTickInOrderWhileOthersLook) {
  const test::TemporaryFolder folder;
  const auto ticks = test::random_ticks(5000, 2, kRecorderRate, 11);
  SpscRing<TickRecord> ring(128);  // wraps around many times
  std::vector<std::uint64_t> observed;
  auto recorder = Recorder::start(
      ring, folder / "run.h5", test::example_header(2, kRecorderRate),
      [&](const TickRecord& tick, std::span<const RecordingEvent>) { observed.push_back(tick.state_hash); });
  ASSERT_TRUE(recorder) << recorder.error().message();

  std::atomic<bool> pushed = false;
  std::thread servo([&] {
    push_all(ring, ticks);
    pushed = true;
  });
  for (std::uint64_t last = 0; !pushed;) {
    const RecordingSummary now = (*recorder)->so_far();
    EXPECT_GE(now.ticks, last);
    last = now.ticks;
    EXPECT_FALSE((*recorder)->failure());
    std::this_thread::yield();
  }
  servo.join();
  // the last ticks are still in the ring
  const auto finished = (*recorder)->finish(3, 4, kFailure);
  ASSERT_TRUE(finished) << finished.error().message();

  RecordingSummary expected = summary_of(ticks);
  expected.dropped = 3;
  expected.skipped = 4;
  expected.problems = kFailure;
  EXPECT_EQ(test::first_difference(*finished, expected), "");
  EXPECT_EQ(test::first_difference((*recorder)->so_far(), expected), "");
  ASSERT_EQ(observed.size(), ticks.size());
  for (std::size_t i = 0; i < observed.size(); ++i)
    ASSERT_EQ(observed[i], ticks[i].state_hash) << "tick " << i;

  const auto read = read_recording(folder / "run.h5");
  ASSERT_TRUE(read) << read.error().message();
  ASSERT_EQ((*read).ticks.size(), ticks.size());
  expect_beginning((*read).ticks, ticks);
  ASSERT_TRUE((*read).summary);
  EXPECT_EQ(test::first_difference(*(*read).summary, expected), "");
}

TEST(Recorder, WithoutAFileStillCountsAndSees) {
  const auto ticks = test::example_ticks(700, 1, kRecorderRate);
  SpscRing<TickRecord> ring(1024);
  std::uint64_t observed = 0;
  auto recorder = Recorder::start(ring, "", test::example_header(1, kRecorderRate),
                                  [&](const TickRecord&, std::span<const RecordingEvent>) { ++observed; });
  ASSERT_TRUE(recorder);
  push_all(ring, ticks);
  const auto finished = (*recorder)->finish(0, 0, {});
  ASSERT_TRUE(finished);
  EXPECT_EQ(test::first_difference(*finished, summary_of(ticks)), "");
  EXPECT_EQ(observed, ticks.size());
}

TEST(Recorder, DrainsTheRingBeforeItEnds) {
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(900, 1, kRecorderRate);
  SpscRing<TickRecord> ring(1024);
  {
    auto recorder = Recorder::start(ring, folder / "run.h5", test::example_header(1, kRecorderRate));
    ASSERT_TRUE(recorder);
    push_all(ring, ticks);
  }
  EXPECT_EQ(ring.size(), 0u);
  const auto read = read_recording(folder / "run.h5");
  ASSERT_TRUE(read) << read.error().message();
  EXPECT_FALSE((*read).summary) << "it was not finished";
  ASSERT_EQ((*read).ticks.size(), ticks.size());
  expect_beginning((*read).ticks, ticks);
}

TEST(Recorder, DoesNotStartWhereNoFileCanBe) {
  SpscRing<TickRecord> ring(16);
  const auto recorder = Recorder::start(ring, "/nonexistent-folder/run.h5", test::example_header(1));
  ASSERT_FALSE(recorder);
  EXPECT_EQ(recorder.error().kind, ErrorKind::kOutput);
}

// servo with counters of acknowledged commands, used by several threads
struct ReportingServo {
  EventLog reported;
  std::atomic<std::uint32_t> version{1}, settings{0}, arming{0};

  void append(RecordingEvent::Kind kind, std::atomic<std::uint32_t>& channel, RequestedBy by) {
    reported.append([&] {
      RecordingEvent event;
      event.kind = kind;
      event.by = by;
      // the servo may read the counter immediately, and this thread may be preempted here
      event.number = channel.fetch_add(1) + 1;
      std::this_thread::yield();
      event.change.version = kind == RecordingEvent::Kind::kModel ? event.number : 0;
      return event;
    });
  }
  void look(TickRecord& tick) const {
    tick.model_version = version;
    tick.settings_number = settings;
    tick.arming_number = arming;
  }
};

TEST(Recorder, EventsAreAtTheFirstTickTheyAffect) {
  const test::TemporaryFolder folder;
  auto ticks = test::example_ticks(20'000, 1, kRate);
  ReportingServo servo;
  SpscRing<TickRecord> ring(64);
  std::vector<RecordingEvent> heard_live;
  const auto on_tick = [&](const TickRecord& tick, std::span<const RecordingEvent> events) {
    for (const RecordingEvent& event : events) EXPECT_EQ(event.tick, tick.tick);
    heard_live.insert(heard_live.end(), events.begin(), events.end());
  };
  auto recorder =
      Recorder::start(ring, folder / "run.h5", test::example_header(1, kRate), on_tick, &servo.reported);
  ASSERT_TRUE(recorder) << recorder.error().message();
  // faster than the ticks, so that many commands share a tick; bounded in number in case ticks take long
  std::atomic<bool> over = false;
  std::vector<std::thread> tellers;
  for (std::uint32_t teller = 0; teller < 2; ++teller)
    tellers.emplace_back([&, teller] {
      for (int i = 0; !over && i < 2000; ++i) {
        if (teller == 0 && i % 2 == 0) servo.append(RecordingEvent::Kind::kModel, servo.version, {});
        servo.append(RecordingEvent::Kind::kSettings, servo.settings, {Originator::kControlViewer, teller});
        servo.append(i % 2 == 0 ? RecordingEvent::Kind::kStop : RecordingEvent::Kind::kRearm, servo.arming,
                     {Originator::kKey, teller});
        std::this_thread::sleep_for(std::chrono::microseconds(50));
      }
    });
  for (TickRecord& tick : ticks) {
    servo.look(tick);
    // every hundredth tick is lost
    if (tick.tick % 100 == 50) continue;
    while (!ring.push(tick)) std::this_thread::yield();
  }
  over = true;
  for (std::thread& teller : tellers) teller.join();
  ASSERT_TRUE((*recorder)->finish(0, 0, {}));

  const auto read = read_recording(folder / "run.h5");
  ASSERT_TRUE(read) << read.error().message();
  std::map<std::uint64_t, const TickRecord*> by_number;
  for (const TickRecord& tick : ticks)
    if (tick.tick % 100 != 50) by_number[tick.tick] = &tick;
  const auto collected = [](const TickRecord& tick, const RecordingEvent& event) {
    return (event.kind == RecordingEvent::Kind::kModel      ? tick.model_version
            : event.kind == RecordingEvent::Kind::kSettings ? tick.settings_number
                                                            : tick.arming_number) >= event.number;
  };
  std::array<std::set<std::uint32_t>, 3> numbers;
  for (const RecordingEvent& event : read->events) {
    const auto at = by_number.find(event.tick);
    ASSERT_NE(at, by_number.end());
    EXPECT_TRUE(collected(*at->second, event)) << event.tick;
    if (at != by_number.begin()) {
      EXPECT_FALSE(collected(*std::prev(at)->second, event)) << event.tick;
    }
    numbers[std::min<std::size_t>(static_cast<std::size_t>(event.kind), 2)].insert(event.number);
  }
  // exactly the events acknowledged by the last tick, each once
  const TickRecord& last = *by_number.rbegin()->second;
  EXPECT_EQ(numbers[0].size(), last.model_version - 1);
  EXPECT_EQ(numbers[1].size(), last.settings_number);
  EXPECT_EQ(numbers[2].size(), last.arming_number);
  EXPECT_EQ(read->events.size(), numbers[0].size() + numbers[1].size() + numbers[2].size());
  EXPECT_GT(read->events.size(), 100u);
  EXPECT_EQ(heard_live, read->events) << "whoever sees ticks hears of the same";
}

// a writer that blocks until it is released
class StuckWriter : public RecordingWriter {
 public:
  explicit StuckWriter(std::binary_semaphore& entered, std::binary_semaphore& let_go)
      : entered_(entered), released_(let_go) {}
  Result<void> append(std::span<const TickRecord>, std::span<const RecordingEvent>) override {
    entered_.release();
    released_.acquire();
    return {};
  }
  Result<void> finish(const RecordingSummary&) override { return {}; }

 private:
  std::binary_semaphore& entered_;
  std::binary_semaphore& released_;
};

TEST(Recorder, StalledDiskBlocksNeitherRingNorStatus) {
  const auto ticks = test::example_ticks(17, 1, kRecorderRate);
  SpscRing<TickRecord> ring(16);
  std::binary_semaphore entered(0), let_go(0);
  auto recorder =
      internal::start_recorder(ring, std::make_unique<StuckWriter>(entered, let_go), "run.h5", {});
  ASSERT_TRUE(recorder);
  ASSERT_TRUE(ring.push(ticks[0]));
  entered.acquire();
  // during the write the whole ring is free, and queries do not block
  EXPECT_EQ((*recorder)->so_far().ticks, 1u);
  EXPECT_FALSE((*recorder)->failure());
  for (std::size_t i = 1; i < ticks.size(); ++i) EXPECT_TRUE(ring.push(ticks[i])) << i;
  EXPECT_FALSE(ring.push(ticks[0]));
  let_go.release();
  entered.acquire();
  let_go.release();
  const auto finished = (*recorder)->finish(1, 0, {});
  ASSERT_TRUE(finished);
  EXPECT_EQ(finished.value().ticks, ticks.size());
  EXPECT_EQ(finished.value().dropped, 1u);
}

// steps of a recorder without failures: until the file exists, until the ticks are written, until the end
struct Steps {
  std::size_t created, appended, finished;
};
Steps healthy_steps(const std::vector<TickRecord>& ticks) {
  test::MemorySink::Disk disk;
  Steps steps{};
  auto writer = internal::create_on(std::make_unique<test::MemorySink>(disk),
                                    test::example_header(1, kRecorderRate), "run.h5");
  EXPECT_TRUE(writer);
  steps.created = disk.steps.size();
  EXPECT_TRUE((*writer)->append(ticks));
  steps.appended = disk.steps.size();
  EXPECT_TRUE((*writer)->finish(summary_of(ticks)));
  steps.finished = disk.steps.size();
  return steps;
}

TEST(Recorder, AFullDiskStopsTheFileAndNothingElse) {
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(2500, 1, kRecorderRate);
  const Steps steps = healthy_steps(ticks);
  // fails in the second chunk of ticks, so that the first is preserved
  test::MemorySink::Disk disk;
  disk.fails_at = steps.created + (steps.appended - steps.created) / 2 - 3;
  auto writer = internal::create_on(std::make_unique<test::MemorySink>(disk),
                                    test::example_header(1, kRecorderRate), "run.h5");
  ASSERT_TRUE(writer);
  SpscRing<TickRecord> ring(64);
  std::uint64_t observed = 0;
  auto recorder =
      internal::start_recorder(ring, std::move(*writer), "run.h5",
                               [&](const TickRecord&, std::span<const RecordingEvent>) { ++observed; });
  ASSERT_TRUE(recorder);
  // would block if the ring were no longer drained
  push_all(ring, ticks);
  const auto failure = [&] {
    for (;; std::this_thread::yield())
      if (auto error = (*recorder)->failure()) return *error;
  }();
  EXPECT_EQ(failure.kind, ErrorKind::kOutput);
  EXPECT_EQ(failure.where, "run.h5");
  EXPECT_THAT(failure.what, HasSubstr("disk is full"));
  EXPECT_THAT(failure.remedy, HasSubstr("the first 800 ticks are kept"));
  const std::size_t steps_at_failure = disk.steps.size();

  // the same error, and all ticks are counted nevertheless
  push_all(ring, std::span(ticks).first(100));
  const auto finished = (*recorder)->finish(0, 0, {});
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().message(), failure.message());
  EXPECT_EQ((*recorder)->so_far().ticks, ticks.size() + 100);
  EXPECT_EQ(observed, ticks.size() + 100);
  EXPECT_EQ(disk.steps.size(), steps_at_failure) << "written to a full disk";

  test::write_bytes(folder / "run.h5", disk.file);
  const auto read = test::read_in_this_process(folder / "run.h5");
  ASSERT_TRUE(read) << read.error().message();
  EXPECT_FALSE((*read).summary);
  EXPECT_EQ((*read).ticks.size(), 800u);
  expect_beginning((*read).ticks, ticks);
}

TEST(Recorder, ADiskThatIsFullAtTheVeryEndIsAnErrorToo) {
  const auto ticks = test::example_ticks(800, 1, kRecorderRate);
  const Steps steps = healthy_steps(ticks);
  ASSERT_LT(steps.appended, steps.finished);
  test::MemorySink::Disk disk;
  disk.fails_at = steps.appended;
  auto writer = internal::create_on(std::make_unique<test::MemorySink>(disk),
                                    test::example_header(1, kRecorderRate), "run.h5");
  ASSERT_TRUE(writer);
  SpscRing<TickRecord> ring(1024);
  auto recorder = internal::start_recorder(ring, std::move(*writer), "run.h5", {});
  ASSERT_TRUE(recorder);
  push_all(ring, ticks);
  const auto finished = (*recorder)->finish(0, 0, {});
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().kind, ErrorKind::kOutput);
  ASSERT_TRUE((*recorder)->failure());
  EXPECT_EQ((*recorder)->failure()->message(), finished.error().message());
}

// child process that records until it is killed, and occasionally reports the number of pushed ticks
void record_through_the_ring(const fs::path& file, std::span<const TickRecord> ticks, int report) {
  SpscRing<TickRecord> ring(512);
  auto recorder = Recorder::start(ring, file, test::example_header(1, kRecorderRate));
  if (!recorder) ::_exit(1);
  for (std::uint64_t pushed = 0; pushed + 100 <= ticks.size(); pushed += 100) {
    push_all(ring, ticks.subspan(pushed, 100));
    const std::uint64_t total = pushed + 100;
    if (::write(report, &total, sizeof total) != sizeof total) ::_exit(1);
  }
  ::_exit(0);
}

TEST(Recorder, KilledLeavesARecordingThatOpens) {
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(12'000, 1, kRecorderRate);
  const std::uint64_t seed = 20260301;
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  for (int round = 0; round < 5; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    int ends[2];
    ASSERT_EQ(::pipe(ends), 0);
    const fs::path file = folder / ("run" + std::to_string(round) + ".h5");
    const pid_t child = ::fork();
    if (child == 0) record_through_the_ring(file, ticks, ends[1]);
    ::close(ends[1]);
    std::uint64_t pushed = 0, total = 0;
    for (std::uint64_t enough = 1000 + random() % 4000; pushed < enough;)
      ASSERT_EQ(::read(ends[0], &pushed, sizeof pushed), static_cast<ssize_t>(sizeof pushed));
    test::kill_between_writes(child);
    while (::read(ends[0], &total, sizeof total) == sizeof total) pushed = total;
    ::close(ends[0]);

    const auto read = read_recording(file);
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_FALSE((*read).summary);
    // lost: less than a second, plus the content of the ring and of the recorder's batch
    EXPECT_GT((*read).ticks.size() + 1000 + 512 + 256, pushed);
    expect_beginning((*read).ticks, ticks);
  }
}

}  // namespace
}  // namespace palpate
