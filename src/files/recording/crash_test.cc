// Recordings whose process is killed or whose disk is full.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <random>
#include <thread>

#include "base/test_seed.h"
#include "recording/columns.h"
#include "recording/hdf5_types.h"
#include "recording/recording_file.h"
#include "recording/stream.h"
#include "recording/test_support.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// "" or the first tick of `read` that differs from `written`
std::string not_a_beginning(const std::vector<TickRecord>& read, const std::vector<TickRecord>& written) {
  if (read.size() > written.size()) return "more ticks than were written";
  for (std::size_t i = 0; i < read.size(); ++i)
    if (const auto field = test::first_difference(read[i], written[i]); !field.empty())
      return "tick " + std::to_string(i) + " " + field;
  return "";
}

// "" or the difference between the events read with a prefix of the ticks and those written
std::string wrong_events(const Recording& read, const std::vector<RecordingEvent>& written) {
  const std::size_t due = read.ticks.empty() ? 0 : internal::events_up_to(written, read.ticks.back().tick);
  if (read.events.size() != due)
    return std::to_string(read.events.size()) + " events and not " + std::to_string(due);
  for (std::size_t i = 0; i < due; ++i)
    if (const auto field = test::first_difference(read.events[i], written[i]); !field.empty())
      return "event " + std::to_string(i) + " " + field;
  return "";
}

// Reads the file as h5py and MATLAB do: every column by plain HDF5 over its own extent. Returns "" or the
// first column that is not a prefix of what was written, or that lacks an event acknowledged by a tick.
std::string wrong_column(const fs::path& file, const std::vector<TickRecord>& written,
                         const std::vector<RecordingEvent>& events = {}) {
  const internal::Hdf5Section section;
  const internal::Handle opened(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (!opened.ok()) return "HDF5 does not open the file";
  std::size_t ticks = 0;  // rows of the longest tick column
  const auto check = [&](const std::string& name, const internal::Column& column, std::size_t min_rows,
                         std::size_t max_rows, const auto& record_of) -> std::string {
    const internal::Handle data_set(H5Dopen2(opened.get(), name.c_str(), H5P_DEFAULT), H5Dclose);
    const internal::Handle space(H5Dget_space(data_set.get()), H5Sclose);
    hsize_t extent[2] = {0, 1};
    if (H5Sget_simple_extent_dims(space.get(), extent, nullptr) < 0 || extent[0] > max_rows) return name;
    if (extent[0] < min_rows) return name + " lacks what a tick had heard of";
    std::vector<std::byte> rows(extent[0] * column.row_bytes());
    if (H5Dread(data_set.get(), internal::hdf5_type(column.number), H5S_ALL, H5S_ALL, H5P_DEFAULT,
                rows.data()) < 0)
      return name + " does not read";
    for (std::size_t row = 0; row < extent[0]; ++row) {
      const auto* record = reinterpret_cast<const std::byte*>(record_of(row));
      if (std::memcmp(rows.data() + row * column.row_bytes(), record + column.offset, column.row_bytes()) !=
          0)
        return name + " row " + std::to_string(row);
    }
    ticks = std::max<std::size_t>(ticks, extent[0]);
    return "";
  };
  for (const auto& column : internal::tick_columns())
    if (auto wrong = check(std::string("/ticks/") + column.name, column, 0, written.size(),
                           [&](std::size_t row) { return &written[row]; });
        !wrong.empty())
      return wrong;
  for (const auto& column : internal::device_columns())
    if (auto wrong = check(std::string("/device0/") + column.name, column, 0, written.size(),
                           [&](std::size_t row) { return &written[row].device[0]; });
        !wrong.empty())
      return wrong;
  const std::size_t due = ticks == 0 ? 0 : internal::events_up_to(events, written[ticks - 1].tick);
  for (const auto& column : internal::event_columns())
    if (auto wrong = check(std::string("/events/") + column.name, column, due, events.size(),
                           [&](std::size_t row) { return &events[row]; });
        !wrong.empty())
      return wrong;
  return "";
}

// Ticks at 10 Hz, so that a chunk has 8 and a run crosses the block boundaries of HDF5's chunk index (4, 20,
// 36 chunks). In chunks 6 and 7 the clock is slow, so that they are flushed half full.
constexpr double kRate = 10;
std::vector<TickRecord> many_seconds() {
  auto ticks = test::random_ticks(8 * 39, 1, kRate, 20260301);
  double time_s = 0;
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    ticks[i].tick = i;
    ticks[i].time_s = time_s;
    time_s += (i >= 6 * 8 && i < 8 * 8 ? 3 : 1) / kRate;
  }
  return ticks;
}

// steps of the sink and number of committed ticks after each commit
struct Commit {
  std::size_t steps, ticks;
};

// records a complete run in memory
std::vector<Commit> record_all(const std::vector<TickRecord>& ticks,
                               const std::vector<RecordingEvent>& events, test::MemorySink::Disk& disk) {
  auto writer =
      internal::create_on(std::make_unique<test::MemorySink>(disk), test::example_header(1, kRate), "run.h5");
  EXPECT_TRUE(writer) << writer.error().message();
  std::vector<Commit> commits{{disk.steps.size(), 0}};
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    // at most one event per tick
    const auto first = std::ranges::lower_bound(events, ticks[i].tick, {}, &RecordingEvent::tick);
    const std::size_t event_count = first != events.end() && first->tick == ticks[i].tick;
    EXPECT_TRUE((*writer)->append(std::span(ticks).subspan(i, 1), std::span(first, event_count)));
    if (disk.steps.size() != commits.back().steps) commits.push_back({disk.steps.size(), i + 1});
  }
  EXPECT_TRUE((*writer)->finish(test::example_summary(ticks.size())));
  commits.push_back({disk.steps.size(), ticks.size()});
  return commits;
}

TEST(KilledRecording, IsWholeAfterEveryWrite) {
  const test::TemporaryFolder folder;
  const auto ticks = many_seconds();
  // fewer than a chunk holds, so that only flushes write events
  const auto events = test::random_events(ticks, 5, 4);
  ASSERT_LT(events.size(), 64u);
  test::MemorySink::Disk disk;
  const auto commits = record_all(ticks, events, disk);
  ASSERT_EQ(commits.size(), 1 + 39 + 2 + 1u);

  std::vector<std::byte> file;
  std::size_t done = 0, longest = 0;
  for (std::size_t c = 0; c + 1 < commits.size(); ++c) {
    for (; done < commits[c].steps; ++done) test::replay_step(disk.steps[done], file);
    // the first two commits, the slow ones, new index blocks (chunks 4, 20, 36), the summary
    const bool new_kind = c < 2 || (c > 3 && c < 6) || c == 22 || c == 38 || c + 3 > commits.size();
    if (!new_kind) continue;
    for (; done < commits[c + 1].steps; test::replay_step(disk.steps[done++], file)) {
      SCOPED_TRACE("killed before write " + std::to_string(done) + " of " +
                   std::to_string(disk.steps.size()));
      test::write_bytes(folder / "run.h5", file);
      ASSERT_EQ(wrong_column(folder / "run.h5", ticks, events), "");
      const auto read = test::read_in_this_process(folder / "run.h5");
      ASSERT_TRUE(read) << read.error().message();
      ASSERT_EQ(not_a_beginning((*read).ticks, ticks), "");
      ASSERT_EQ(wrong_events(*read, events), "");
      // committed ticks are never lost, and a run counts as complete only when it is
      ASSERT_GE((*read).ticks.size(), std::max(longest, commits[c].ticks));
      longest = (*read).ticks.size();
      if ((*read).summary) {
        ASSERT_EQ(longest, ticks.size());
      }
    }
  }
  EXPECT_EQ(file, disk.file);
}

TEST(FullDisk, KeepsFlushedTicks) {
  const test::TemporaryFolder folder;
  const auto ticks = test::random_ticks(80, 1, 50, 7);
  // a run without failure determines the number of writes
  test::MemorySink::Disk healthy;
  std::size_t created = 0;
  {
    auto writer = internal::create_on(std::make_unique<test::MemorySink>(healthy),
                                      test::example_header(1, 50), "run.h5");
    ASSERT_TRUE(writer);
    created = healthy.steps.size();
    ASSERT_TRUE((*writer)->append(ticks));
  }
  ASSERT_GT(healthy.steps.size(),
            created + 2 * (internal::tick_columns().size() + internal::device_columns().size()));

  // every write of one second's commit, and samples of the other, similar ones
  const std::size_t last = (created + healthy.steps.size()) / 2;
  for (std::size_t fails_at = 0; fails_at + 1 < healthy.steps.size(); fails_at += fails_at < last ? 7 : 1) {
    SCOPED_TRACE("write " + std::to_string(fails_at) + " of " + std::to_string(healthy.steps.size()) +
                 " fails");
    test::MemorySink::Disk disk;
    disk.fails_at = fails_at;
    std::size_t flushed = 0;
    {
      auto writer = internal::create_on(std::make_unique<test::MemorySink>(disk), test::example_header(1, 50),
                                        "run.h5");
      ASSERT_EQ(writer.ok(), fails_at >= created);
      if (!writer) {
        EXPECT_EQ(writer.error().kind, ErrorKind::kOutput);
        EXPECT_THAT(writer.error().what, HasSubstr("disk is full"));
        continue;
      }
      Result<void> appended;
      for (std::size_t i = 0; i < ticks.size() && appended; i += 40) {
        appended = (*writer)->append(std::span(ticks).subspan(i, 40));
        if (appended) flushed = i + 40;
      }
      ASSERT_FALSE(appended);
      EXPECT_EQ(appended.error().kind, ErrorKind::kOutput);
      EXPECT_THAT(appended.error().what, HasSubstr("disk is full"));
      // the error persists, and nothing blocks or is written afterwards
      EXPECT_FALSE((*writer)->append(std::span(ticks).first(1)));
      EXPECT_FALSE((*writer)->finish(test::example_summary(ticks.size())));
    }
    test::write_bytes(folder / "run.h5", disk.file);
    ASSERT_EQ(wrong_column(folder / "run.h5", ticks), "");
    const auto read = test::read_in_this_process(folder / "run.h5");
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_FALSE((*read).summary);
    EXPECT_GE((*read).ticks.size(), flushed);
    EXPECT_EQ(not_a_beginning((*read).ticks, ticks), "");
  }
}

// child process that records until it is killed, and reports the number of appended ticks after each append
void record_for_ever(const fs::path& file, std::span<const TickRecord> ticks,
                     std::span<const RecordingEvent> events, int report) {
  auto writer = RecordingWriter::create(file, test::example_header(1));
  if (!writer) ::_exit(1);
  for (std::uint64_t supplied = 0; supplied + 100 <= ticks.size(); supplied += 100) {
    const std::size_t event_count = internal::events_up_to(events, ticks[supplied + 99].tick);
    if (!(*writer)->append(ticks.subspan(supplied, 100), events.first(event_count))) ::_exit(1);
    events = events.subspan(event_count);
    const std::uint64_t total = supplied + 100;
    if (::write(report, &total, sizeof total) != sizeof total) ::_exit(1);
  }
  ::_exit(0);
}

TEST(KilledRecording, LosesAtMostTheLastSecond) {
  const test::TemporaryFolder folder;
  // as fast as possible: far above any real rate, mostly inside a write
  const auto ticks = test::example_ticks(40'000, 1, 1000);
  // enough events to fill a chunk between two flushes of ticks
  const auto events = test::random_events(ticks, 7, 2);
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  for (int round = 0; round < 20; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    int ends[2];
    ASSERT_EQ(::pipe(ends), 0);
    const auto file = folder / ("run" + std::to_string(round) + ".h5");
    const pid_t child = ::fork();
    if (child == 0) record_for_ever(file, ticks, events, ends[1]);
    ::close(ends[1]);
    // the file exists once the first ticks are in; then some more milliseconds
    std::uint64_t supplied = 0, total = 0;
    ASSERT_EQ(::read(ends[0], &supplied, sizeof supplied), static_cast<ssize_t>(sizeof supplied));
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 40'000));
    test::kill_between_writes(child);
    while (::read(ends[0], &total, sizeof total) == sizeof total) supplied = total;
    ::close(ends[0]);

    EXPECT_EQ(wrong_column(file, ticks, events), "");
    const auto read = read_recording(file);
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_FALSE((*read).summary);
    EXPECT_GT((*read).ticks.size() + 1000, supplied);
    EXPECT_EQ(not_a_beginning((*read).ticks, ticks), "");
    EXPECT_EQ(wrong_events(*read, events), "");
  }
}

// appends until it fails, then destroys the writer
std::size_t record_until_full(const fs::path& file, std::span<const TickRecord> ticks) {
  auto writer = RecordingWriter::create(file, test::example_header(1, 1250));
  EXPECT_TRUE(writer) << writer.error().message();
  std::size_t flushed = 0;
  for (std::size_t i = 0; i + 1000 <= ticks.size(); i += 1000) {
    const auto appended = (*writer)->append(ticks.subspan(i, 1000));
    if (!appended) {
      EXPECT_EQ(appended.error().kind, ErrorKind::kOutput);
      EXPECT_EQ(appended.error().where, file.string());
      EXPECT_THAT(appended.error().remedy,
                  HasSubstr("the first " + std::to_string(flushed) + " ticks are kept"));
      return flushed;
    }
    flushed = i + 1000;
  }
  ADD_FAILURE() << "the disk did not fill up";
  return flushed;
}

TEST(FullDisk, LeavesARecordingThatReopens) {
  const test::TemporaryFolder folder;
  // incompressible data
  const auto ticks = test::random_ticks(10'000, 1, 1250, 3);
  // a disk of 4 MB if mounting is permitted, otherwise a file size limit
  const bool mounted = fs::create_directory(folder / "disk") &&
                       ::mount("tmpfs", (folder / "disk").c_str(), "tmpfs", 0, "size=4m") == 0;
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{4'000'000, before.rlim_max};
  const auto handler = ::signal(SIGXFSZ, SIG_IGN);
  if (!mounted) ::setrlimit(RLIMIT_FSIZE, &small);

  const auto file = folder / "disk" / "run.h5";
  const std::size_t flushed = record_until_full(file, ticks);
  ::setrlimit(RLIMIT_FSIZE, &before);
  ::signal(SIGXFSZ, handler);
  EXPECT_GE(flushed, 4000u);
  EXPECT_EQ(wrong_column(file, ticks), "");
  const auto read = read_recording(file);
  EXPECT_TRUE(read) << read.error().message();
  if (read) {
    EXPECT_EQ((*read).ticks.size(), flushed);
    EXPECT_EQ(not_a_beginning((*read).ticks, ticks), "");
  }
  // the space after the last complete second is freed
  EXPECT_LT(fs::file_size(file), flushed * internal::tick_bytes(1) + 64'000);

  // a disk too small even for the beginning gets no file
  if (mounted) {
    auto header = test::example_header(1);
    header.script_text = std::string(1'000'000, 'x');
    const auto none = RecordingWriter::create(folder / "disk" / "second.h5", header);
    EXPECT_FALSE(none);
    EXPECT_FALSE(fs::exists(folder / "disk" / "second.h5"));
    ::umount2((folder / "disk").c_str(), MNT_DETACH);
  }
}

}  // namespace
}  // namespace palpate
