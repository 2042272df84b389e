#include "palpate/recording/recording.h"
#include "palpate/recording/recorder.h"
#include "palpate/recording/recording_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <array>
#include <atomic>
#include <cctype>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "base/test_child.h"
#include "base/test_docs.h"
#include "base/test_seed.h"
#include "recording/columns.h"
#include "recording/stream.h"
#include "recording/test_support.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

// writes in pieces of varying size, as a recorder thread does
void write_recording(const std::filesystem::path& file, const RecordingHeader& header,
                     const std::vector<TickRecord>& ticks, std::size_t piece = 37,
                     std::span<const RecordingEvent> events = {}) {
  auto writer = RecordingWriter::create(file, header);
  ASSERT_TRUE(writer) << writer.error().message();
  for (std::span<const TickRecord> remaining(ticks); !remaining.empty();) {
    const auto now = remaining.first(std::min(piece, remaining.size()));
    const auto reported = events.first(internal::events_up_to(events, now.back().tick));
    events = events.subspan(reported.size());
    const auto appended = (*writer)->append(now, reported);
    ASSERT_TRUE(appended) << appended.error().message();
    remaining = remaining.subspan(now.size());
    piece = piece % 501 + 17;
  }
  const auto finished = (*writer)->finish(test::example_summary(ticks.size()));
  ASSERT_TRUE(finished) << finished.error().message();
}

void expect_same(const std::vector<TickRecord>& read, const std::vector<TickRecord>& written) {
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i)
    ASSERT_EQ(test::first_difference(read[i], written[i]), "") << "tick " << i;
}

void expect_same(const std::vector<RecordingEvent>& read, const std::vector<RecordingEvent>& written) {
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i)
    ASSERT_EQ(test::first_difference(read[i], written[i]), "") << "event " << i;
}

// random bits in all fields but the tick numbers, every other of which is missing
std::vector<TickRecord> numbered_ticks(std::size_t count, int devices, double rate_hz, std::uint64_t seed) {
  auto ticks = test::random_ticks(count, devices, rate_hz, seed);
  for (std::size_t i = 0; i < count; ++i) ticks[i].tick = 2 * i;
  return ticks;
}

TEST(Recording, ComesBackBitForBit) {
  const test::TemporaryFolder folder;
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  // around the boundaries of a chunk (400) and of a block of the reader (4096)
  for (const std::size_t count : {0u, 1u, 399u, 400u, 401u, 800u, 4096u, 4097u, 9001u})
    for (const int devices : {1, 2, 4}) {
      if (count > 401 && devices == 2) continue;
      SCOPED_TRACE(std::to_string(count) + " ticks, " + std::to_string(devices) + " devices");
      const auto header = test::example_header(devices, 500);
      const auto ticks = numbered_ticks(count, devices, 500, seed + count);
      // and around the boundaries of a chunk of events (64)
      const auto events = test::random_events(ticks, count < 4096 ? 4 : 97, seed + count);
      write_recording(folder / "run.h5", header, ticks, 37, events);
      const auto read = read_recording(folder / "run.h5");
      ASSERT_TRUE(read) << read.error().message();
      EXPECT_EQ(test::first_difference((*read).header, header), "");
      expect_same((*read).ticks, ticks);
      expect_same((*read).events, events);
      ASSERT_TRUE((*read).summary);
      EXPECT_EQ(test::first_difference(*(*read).summary, test::example_summary(count)), "");
    }
}

TEST(Recording, MoreEventsBeforeATickThanAPartHolds) {
  const test::TemporaryFolder folder;
  const auto ticks = numbered_ticks(5000, 1, 500, 1);
  std::vector<RecordingEvent> events;
  for (const std::size_t tick : {3u, 4500u})
    for (int i = 0; i < 9000; ++i)
      events.push_back(test::random_events(std::span(ticks).subspan(tick, 1), 1, tick + i).front());
  write_recording(folder / "run.h5", test::example_header(1, 500), ticks, 37, events);
  const auto source = RecordingSource::open(folder / "run.h5");
  ASSERT_TRUE(source) << source.error().message();
  std::vector<RecordingEvent> recorded_events;
  std::uint64_t read = 0;
  const auto done = source->read([&](const RecordingPart& part) -> Result<void> {
    EXPECT_LE(part.ticks.size(), 4096u);
    EXPECT_LE(part.events.size(), 4096u);
    recorded_events.insert(recorded_events.end(), part.events.begin(), part.events.end());
    // the events acknowledged by these ticks are present
    for (const TickRecord& tick : part.ticks) {
      EXPECT_EQ(tick.tick, 2 * read++);
      const std::size_t due = tick.tick < 6 ? 0u : tick.tick < 9000 ? 9000u : 18000u;
      EXPECT_GE(recorded_events.size(), due);
    }
    return {};
  });
  ASSERT_TRUE(done) << done.error().message();
  EXPECT_EQ(read, ticks.size());
  expect_same(recorded_events, events);
}

// the reader's child process and a recording in memory give the same head
TEST(RecordingSource, ReportsHeaderAndRereadsTicks) {
  const test::TemporaryFolder folder;
  auto ticks = test::example_ticks(9000, 1, 1000);
  for (std::size_t i = 0; i < ticks.size(); ++i) ticks[i].method = i < 5 ? 5 : i < 8000 ? 1 : 200;
  for (const bool rises : {true, false}) {
    SCOPED_TRACE(rises);
    if (!rises) ticks[8500].time_s = ticks[8499].time_s;
    write_recording(folder / "run.h5", test::example_header(1), ticks, 37, test::example_events());
    const auto recording = read_recording(folder / "run.h5");
    ASSERT_TRUE(recording) << recording.error().message();
    const auto opened = RecordingSource::open(folder / "run.h5");
    ASSERT_TRUE(opened) << opened.error().message();
    for (const RecordingSource& source : {*opened, RecordingSource(*recording)}) {
      const RecordingHead& head = source.head();
      EXPECT_EQ(head.ticks, ticks.size());
      EXPECT_EQ(head.is_clock_monotonic, rises);
      ASSERT_EQ(head.methods.size(), 3u);
      EXPECT_EQ(head.methods[0].method, 5);
      EXPECT_EQ(head.methods[1].method, 1);
      EXPECT_EQ(head.methods[1].tick, 5u);
      EXPECT_EQ(head.methods[2].method, 200);
      EXPECT_EQ(head.methods[2].tick, 8000u);
      EXPECT_EQ(test::first_difference(head.header, test::example_header(1)), "");
      ASSERT_TRUE(head.summary);
      for (int pass = 0; pass < 2; ++pass) {
        std::size_t read = 0;
        std::vector<RecordingEvent> events;
        const auto done = source.read([&](const RecordingPart& part) -> Result<void> {
          for (const TickRecord& tick : part.ticks)
            EXPECT_EQ(test::first_difference(tick, ticks.at(read++)), "");
          events.insert(events.end(), part.events.begin(), part.events.end());
          return {};
        });
        ASSERT_TRUE(done) << done.error().message();
        EXPECT_EQ(read, ticks.size());
        expect_same(events, test::example_events());
      }
    }
  }
}

TEST(RecordingSource, ReadsTicksAtAnyPlace) {
  const test::TemporaryFolder folder;
  const auto ticks = test::random_ticks(10000, 2, 1000, 31);
  write_recording(folder / "run.h5", test::example_header(2), ticks, 37, test::example_events());
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording) << recording.error().message();
  const auto opened = RecordingSource::open(folder / "run.h5");
  ASSERT_TRUE(opened) << opened.error().message();
  const std::pair<std::uint64_t, std::uint64_t> kRanges[] = {{0, 1},     {4095, 2},  {9999, 5}, {2000, 4200},
                                                             {10000, 3}, {20000, 3}, {17, 0}};
  for (const RecordingSource& source : {*opened, RecordingSource(*recording)})
    for (const auto& [first, count] : kRanges) {
      SCOPED_TRACE(std::to_string(count) + " from " + std::to_string(first));
      const auto read = source.read_at(first, count);
      ASSERT_TRUE(read) << read.error().message();
      ASSERT_EQ(read->size(), first < 10000 ? std::min(count, 10000 - first) : 0);
      for (std::size_t i = 0; i < read->size(); ++i)
        ASSERT_EQ(test::first_difference((*read)[i], ticks[first + i]), "") << i;
    }
  // another file under the same name
  write_recording(folder / "run.h5", test::example_header(1), test::example_ticks(10000, 1, 1000), 37, {});
  const auto read = opened->read_at(0, 3);
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().what.find("was replaced"), std::string::npos);
}

TEST(RecordingSource, ReaderCanStopEarly) {
  const test::TemporaryFolder folder;
  write_recording(folder / "run.h5", test::example_header(1), test::example_ticks(20000, 1, 1000));
  const auto source = RecordingSource::open(folder / "run.h5");
  ASSERT_TRUE(source);
  int parts = 0;
  const auto ended = source->read([&](const RecordingPart&) -> Result<void> {
    if (++parts < 2) return {};
    return Error{ErrorKind::kOutput, "enough", "here", ""};
  });
  ASSERT_FALSE(ended);
  EXPECT_EQ(ended.error().message(), "here: enough");
  EXPECT_EQ(parts, 2);
  const std::atomic<bool> stop = true;
  const auto stopped = source->read([](const RecordingPart&) -> Result<void> { return {}; }, {{}, &stop});
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().kind, ErrorKind::kInterrupted);
}

TEST(RecordingSource, ReadsAsFarAsItWasOpenedAndNothingElse) {
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(3200, 1, 1000);
  auto writer = RecordingWriter::create(folder / "run.h5", test::example_header(1));
  ASSERT_TRUE(writer);
  ASSERT_TRUE((*writer)->append(std::span(ticks).first(800), test::example_events()));
  const auto source = RecordingSource::open(folder / "run.h5");
  ASSERT_TRUE(source);
  EXPECT_EQ(source->head().ticks, 800u);
  // it grows, and later events belong to later ticks
  auto later = test::example_events();
  for (RecordingEvent& event : later) event.tick += 1000;
  ASSERT_TRUE((*writer)->append(std::span(ticks).subspan(800), later));
  std::size_t read = 0, reported = 0;
  const auto count = [&](const RecordingPart& part) -> Result<void> {
    read += part.ticks.size();
    reported += part.events.size();
    return {};
  };
  ASSERT_TRUE(source->read(count));
  EXPECT_EQ(read, 800u);
  EXPECT_EQ(reported, 2u);
  // another run under the same name
  auto header = test::example_header(1);
  header.seed += 1;
  write_recording(folder / "run.h5", header, ticks);
  const auto other = source->read(count);
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().what, HasSubstr("the recording was replaced"));
  EXPECT_EQ(other.error().where, (folder / "run.h5").string());
}

std::vector<std::string> problems_after_reading(const std::vector<std::string>& problems) {
  const test::TemporaryFolder folder;
  auto writer = RecordingWriter::create(folder / "run.h5", test::example_header(1));
  EXPECT_TRUE(writer);
  RecordingSummary summary;
  summary.problems = problems;
  EXPECT_TRUE((*writer)->finish(summary));
  const auto read = read_recording(folder / "run.h5");
  EXPECT_TRUE(read) << read.error().message();
  return read && read->summary ? read->summary->problems : std::vector<std::string>{"no summary"};
}

TEST(Recording, BoundsTheNumberOfProblems) {
  EXPECT_EQ(problems_after_reading({}), std::vector<std::string>{});
  // around the boundaries of a chunk (16) and up to the maximum
  for (const std::size_t count : {1u, 15u, 16u, 17u, 1000u}) {
    std::vector<std::string> problems;
    for (std::size_t i = 0; i < count; ++i) problems.push_back("step " + std::to_string(i));
    EXPECT_EQ(problems_after_reading(problems), problems);
  }
  const auto most = problems_after_reading(std::vector<std::string>(1003, "again"));
  ASSERT_EQ(most.size(), 1000u);
  EXPECT_EQ(most[998], "again");
  EXPECT_EQ(most[999], "and 4 more");

  // a long sentence is truncated between two characters, also if the limit is inside a ü
  const std::string whole(512, 'x');
  EXPECT_EQ(problems_after_reading({whole, whole + "x"}),
            (std::vector<std::string>{whole, std::string(509, 'x') + "..."}));
  EXPECT_EQ(problems_after_reading({std::string(508, 'x') + "üüü", std::string("a\0b", 3)}),
            (std::vector<std::string>{std::string(508, 'x') + "...", "ab"}));
}

TEST(Recording, TableCoversEveryFieldOnce) {
  // columns of a tick do not overlap
  std::vector<bool> tick(sizeof(TickRecord)), device(sizeof(DeviceTick));
  const auto claim = [](std::vector<bool>& bytes, const internal::Column& column) {
    for (std::size_t i = column.offset; i < column.offset + column.row_bytes(); ++i) {
      EXPECT_FALSE(bytes.at(i)) << column.name;
      bytes.at(i) = true;
    }
  };
  for (const auto& column : internal::tick_columns()) claim(tick, column);
  for (const auto& column : internal::device_columns()) claim(device, column);
  // not covered: TickRecord::devices, which is in the header, the devices themselves, and padding
  const auto unclaimed = [](const std::vector<bool>& bytes) { return std::ranges::count(bytes, false); };
  EXPECT_EQ(unclaimed(tick), static_cast<std::ptrdiff_t>(sizeof(TickRecord) - internal::tick_bytes(0)));
  EXPECT_EQ(internal::tick_bytes(0), 130u);
  EXPECT_EQ(internal::tick_bytes(1), 130u + 908u);
  EXPECT_EQ(internal::tick_bytes(4), 130u + 4 * 908u);
  EXPECT_LT(unclaimed(device), 8) << "a field of DeviceTick without a column";
  // counters from which the recorder derives events have no column, either
  EXPECT_LT(static_cast<std::size_t>(unclaimed(tick)),
            sizeof(TickRecord::device) + sizeof(TickRecord::devices) + sizeof(TickRecord::settings_number) +
                sizeof(TickRecord::arming_number) + 12)
      << "a field of TickRecord without a column";
  std::vector<bool> event(sizeof(RecordingEvent));
  std::size_t padding = 0;
  for (const auto& column : internal::event_columns()) claim(event, column);
  // the change's version equals the event's number; the rest is padding around numbers of four and eight
  // bytes
  for (std::size_t i = 0; i < event.size(); ++i) padding += !event[i];
  EXPECT_LT(padding, sizeof(ModelChange::version) + 7 + 3 + 4 + 4 + 4)
      << "a field of RecordingEvent without a column";
}

TEST(Recording, DescribesEveryBit) {
  const auto description = [](std::span<const internal::Column> columns, std::string_view name) {
    const auto found =
        std::ranges::find_if(columns, [&](const internal::Column& column) { return column.name == name; });
    return found == columns.end() ? std::string("no such column") : found->description();
  };
  EXPECT_THAT(description(internal::tick_columns(), "switches"),
              ::testing::StartsWith("switches that are on: 1 friction, 2 viscosity, 4 paused, 8 emergency "
                                    "stop, 16 passivity, 32 motor"));
  EXPECT_EQ(description(internal::device_columns(), "status"),
            "input: conditions of the device: 1 fault, 2 clutched, 4 halted, 8 set down");
  EXPECT_EQ(description(internal::event_columns(), "kind"),
            "kind of request: 0 model, 1 settings, 2 stop, 3 rearm, 4 sweep, 5 tissue solved");
  EXPECT_EQ(
      description(internal::event_columns(), "requested_by"),
      "source of the request: 0 the session itself, 1 script, 2 key, 3 viewer with control, 4 viewer with "
      "view, 5 viewer with control, accepted by a key");
  EXPECT_THAT(description(internal::event_columns(), "changed"),
              HasSubstr(": 1 method, 2 friction, 4 viscosity, 8 passivity, 16 paused, 32 force limit, 64 "
                        "rotation, 128 tip taken or released, 256 motor"));
  const std::string flags = description(internal::device_columns(), "flags");
  EXPECT_THAT(flags, HasSubstr(": 1 clamped, 2 not finite, "));
  EXPECT_THAT(flags, ::testing::EndsWith(", 8388608 release, 16777216 break-through"));
  EXPECT_EQ(std::ranges::count(flags, ','), 24 + 1);  // one more comma in the preceding sentence
}

/// Table of docs/reference/flags.md: its heading, and rows of cells by bit.
std::string bit_table(const std::string& of, const std::vector<std::string>& heading,
                      const std::map<unsigned, std::vector<std::string>>& rows) {
  const auto cells = [](const std::vector<std::string>& texts) {
    std::string row;
    for (const std::string& text : texts) row += " " + text + " |";
    return row + "\n";
  };
  std::string text = "| Of | Value |" + cells(heading) + "|---|---|";
  for (std::size_t n = 0; n < heading.size(); ++n) text += "---|";
  text += "\n";
  for (const auto& [bit, row] : rows) text += "| `" + of + "` | " + std::to_string(bit) + " |" + cells(row);
  return text;
}
std::string sentence(std::string text) {
  text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text + ".";
}
std::vector<std::string> changed_row(const SwitchInfo& info) {
  return {std::string(info.name), "Whether " + std::string(info.about) + "."};
}
template <class Value, class Change>
std::vector<std::string> changed_row(const SettingInfo<Value, Change>& info) {
  return {std::string(info.words), sentence(std::string(info.about))};
}

TEST(Docs, FlagsListSwitchesAndSettingsOfTheirTables) {
  std::map<unsigned, std::vector<std::string>> switches{
      {kSwitchEmergencyStop, {"emergency stop", "Forces are off.", "`stop`"}}},
      changed{{kSettingPointer,
               {"tip taken or released",
                "A viewer took the tip, or released or lost it. Nothing of the settings."}}};
  for (const SwitchInfo& info : kSwitches)
    switches[info.recorded] = {std::string(info.name), sentence(std::string(info.about)),
                               info.is_haptic ? "`feel`" : "`hand`"};
  visit_settings([&](const auto& setting) { changed[setting.changed] = changed_row(setting); });
  test::check_docs_section(PALPATE_SOURCE_DIR, "reference/flags.md", "switches",
                           bit_table("switches", {"Name", "Meaning", "Permission"}, switches));
  test::check_docs_section(PALPATE_SOURCE_DIR, "reference/flags.md", "changed",
                           bit_table("changed", {"Name", "Meaning"}, changed));
}

TEST(RecordingSummary, CountsEachFlagOfATickOnce) {
  using Count = std::uint64_t RecordingSummary::*;
  const std::vector<std::pair<TickFlag, Count>> counted{
      {kFlagClamped, &RecordingSummary::clamped},
      {kFlagNotFinite, &RecordingSummary::not_finite},
      {kFlagOutside, &RecordingSummary::outside},
      {kFlagPaused, &RecordingSummary::paused},
      {kFlagRotationIgnored, &RecordingSummary::rotation_ignored},
      {kFlagThermal, &RecordingSummary::thermal},
      {kFlagSlew, &RecordingSummary::slewed},
      {kFlagStale, &RecordingSummary::stale},
      {kFlagJump, &RecordingSummary::jumped},
      {kFlagDeviceFault, &RecordingSummary::device_faults},
      {kFlagHalted, &RecordingSummary::halted},
      {kFlagEmergencyStop, &RecordingSummary::emergency_stopped},
      {kFlagClutched, &RecordingSummary::clutched},
      {kFlagRamp, &RecordingSummary::ramped},
      {kFlagBlend, &RecordingSummary::blended},
      {kFlagMethodMissing, &RecordingSummary::method_missing},
      {kFlagInside, &RecordingSummary::inside},
      {kFlagWedged, &RecordingSummary::wedged},
      {kFlagRuptured, &RecordingSummary::ruptured},
      {kFlagPassivity, &RecordingSummary::passivated},
      {kFlagRotationLimited, &RecordingSummary::rotation_limited}};
  for (const auto& [flag, count] : counted) {
    SCOPED_TRACE(flag);
    RecordingSummary summary, expected;
    TickRecord tick;
    tick.devices = 2;
    summary.observe(tick);
    // on one device, on the other, on both, and on a device that does not exist
    tick.device[0].flags = flag;
    summary.observe(tick);
    tick.device[1].flags = flag | kFlagContact;
    summary.observe(tick);
    tick.device[0].flags = 0;
    summary.observe(tick);
    tick.device[1].flags = kFlagContact;
    tick.device[2].flags = flag;
    summary.observe(tick);
    expected.ticks = 5;
    expected.*count = 3;
    expected.run_hash = summary.run_hash;
    EXPECT_EQ(test::first_difference(summary, expected), "");
  }
}

TEST(RecordingSummary, MixesTheHashOfEveryTick) {
  RecordingSummary summary;
  std::uint64_t expected = 0;
  for (const TickRecord& tick : test::example_ticks(3, 1, 1000)) {
    summary.observe(tick);
    expected = mix_run_hash(expected, tick.state_hash);
  }
  EXPECT_EQ(summary.run_hash, expected);
}

// Bytes of a file without the object header of the superblock extension, which contains the second of its
// creation; no setting of HDF5 prevents that.
std::vector<std::byte> without_time(const std::filesystem::path& file) {
  constexpr std::size_t kBegin = 48, kEnd = 108;
  auto bytes = test::read_bytes(file);
  EXPECT_EQ(std::string_view(reinterpret_cast<const char*>(bytes.data()) + kBegin, 4), "OHDR");
  EXPECT_EQ(std::string_view(reinterpret_cast<const char*>(bytes.data()) + kEnd, 4), "OHDR");
  std::fill(bytes.begin() + kBegin, bytes.begin() + kEnd, std::byte{0});
  return bytes;
}

TEST(Recording, IsTheSameBytesForTheSameRun) {
  // a file contains no machine-dependent data and no uninitialised memory
  const test::TemporaryFolder folder;
  const auto header = test::example_header();
  const auto ticks = test::example_ticks(2345, 2, 1000);
  // fresh memory filled with one pattern, then with another
  ::mallopt(M_PERTURB, 0x5a);
  write_recording(folder / "a.h5", header, ticks, 7);
  ::mallopt(M_PERTURB, 0xa5);
  write_recording(folder / "b.h5", header, ticks, 400);
  ::mallopt(M_PERTURB, 0);
  EXPECT_TRUE(without_time(folder / "a.h5") == without_time(folder / "b.h5"));
}

TEST(Recording, HoldsNoPath) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder / "DOE^CANARY");
  const auto file = folder / "DOE^CANARY" / "DOE^JANE.h5";
  write_recording(file, test::example_header(), test::example_ticks(1500, 2, 1000));
  const auto bytes = test::read_bytes(file);
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  EXPECT_EQ(text.find("DOE"), text.npos);
  EXPECT_EQ(text.find("CANARY"), text.npos);
  EXPECT_EQ(text.find("JANE"), text.npos);
  EXPECT_EQ(text.find(folder.path().filename().string()), text.npos);
  EXPECT_NE(text.find("knorpel-größe"), text.npos);
}

TEST(Recording, ReplacesAnOlderOneOnlyWhenItCanStart) {
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(10, 2, 1000);
  write_recording(folder / "run.h5", test::example_header(), ticks);
  auto header = test::example_header();
  header.devices = 5;
  const auto refused = RecordingWriter::create(folder / "run.h5", header);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("1 to 4 devices"));
  const auto stored = read_recording(folder / "run.h5");
  ASSERT_TRUE(stored);
  EXPECT_EQ((*stored).ticks.size(), 10u);
  // no temporary file is left
  EXPECT_EQ(folder.count(), 1u);
}

TEST(Recording, RefusesHeadersThatWouldNotComeBack) {
  const test::TemporaryFolder folder;
  const auto refusal = [&](auto&& change) {
    auto header = test::example_header();
    change(header);
    const auto writer = RecordingWriter::create(folder / "run.h5", header);
    if (writer) return std::string("accepted");
    EXPECT_EQ(writer.error().kind, ErrorKind::kBadInput);
    return writer.error().what;
  };
  EXPECT_THAT(refusal([](auto& h) { h.devices = 0; }), HasSubstr("not 0"));
  EXPECT_THAT(refusal([](auto& h) { h.rate_hz = 0; }), HasSubstr("rate"));
  EXPECT_THAT(refusal([](auto& h) { h.rate_hz = std::nan(""); }), HasSubstr("rate"));
  EXPECT_THAT(refusal([](auto& h) { h.clock = "sundial"; }), HasSubstr("virtual or real"));
  EXPECT_THAT(refusal([](auto& h) { h.scene_title = std::string(8193, 'x'); }),
              HasSubstr("scene_title is longer"));
  EXPECT_THAT(refusal([](auto& h) { h.script_text = std::string("a\0b", 3); }),
              HasSubstr("script contains a zero"));
  EXPECT_THAT(refusal([](auto& h) { h.structures[0].name = std::string(8193, 'x'); }),
              HasSubstr("name of a structure"));
  EXPECT_THAT(refusal([](auto& h) { h.structures.resize(65537); }), HasSubstr("structures do not fit"));
  EXPECT_EQ(refusal([](auto& h) { h.scene_title = std::string(8192, 'x'); }), "accepted");
}

TEST(Recording, HoldsTheLongestHeaderAndTheEmptiest) {
  const test::TemporaryFolder folder;
  RecordingHeader longest = test::example_header(4);
  for (std::string* text :
       {&longest.palpate_version, &longest.commit, &longest.build_type, &longest.compiler,
        &longest.simd_target, &longest.started_utc, &longest.data_set, &longest.scene_title, &longest.device,
        &longest.hand, &longest.scheduler, &longest.haptic_settings, &longest.task.name, &longest.task.seed})
    *text = std::string(8192, 'w');
  longest.script_text = std::string(3'000'000, 's');
  for (int i = 0; i < 500; ++i)
    longest.structures.push_back({static_cast<LabelId>(i), std::string(70, 'n'), "t", {}});
  RecordingHeader emptiest;
  for (const auto& header : {longest, emptiest}) {
    write_recording(folder / "run.h5", header, {});
    const auto read = read_recording(folder / "run.h5");
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ(test::first_difference((*read).header, header), "");
  }
}

TEST(Recording, RefusesFoldersThatTakeNoFiles) {
  const auto missing = RecordingWriter::create("/nonexistent-folder/run.h5", test::example_header());
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().kind, ErrorKind::kOutput);
  EXPECT_THAT(missing.error().what, HasSubstr("does not exist"));
  const test::TemporaryFolder folder;
  const auto is_folder = RecordingWriter::create(folder / "", test::example_header());
  ASSERT_FALSE(is_folder);
  EXPECT_EQ(is_folder.error().kind, ErrorKind::kOutput);
}

TEST(Recording, WithoutFinishKeepsEveryTickButHasNoSummary) {
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(2700, 1, 1000);
  {
    auto writer = RecordingWriter::create(folder / "run.h5", test::example_header(1));
    ASSERT_TRUE(writer);
    ASSERT_TRUE((*writer)->append(ticks));
  }
  const auto read = read_recording(folder / "run.h5");
  ASSERT_TRUE(read) << read.error().message();
  EXPECT_FALSE((*read).summary);
  expect_same((*read).ticks, ticks);
}

TEST(Recording, CanBeReadWhileItIsWritten) {
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(3500, 1, 1250);
  auto writer = RecordingWriter::create(folder / "run.h5", test::example_header(1, 1250));
  ASSERT_TRUE(writer);
  for (std::size_t i = 0; i < ticks.size(); i += 500) {
    ASSERT_TRUE((*writer)->append(std::span(ticks).subspan(i, 500)));
    const auto read = read_recording(folder / "run.h5");
    ASSERT_TRUE(read) << read.error().message();
    expect_same((*read).ticks,
                {ticks.begin(), ticks.begin() + static_cast<std::ptrdiff_t>((i + 500) / 1000 * 1000)});
  }
}

TEST(Recording, PartsOfItAreReadWhileItIsWritten) {
  // written by another process, as for a session's recording
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(20'000, 1, 1000);
  const testing::Shared<std::atomic<bool>> is_started;
  testing::Child recorder([&] {
    auto writer = RecordingWriter::create(folder / "run.h5", test::example_header(1, 1000));
    PALPATE_CHECK(writer && (*writer)->append(std::span(ticks).first(2000)));
    *is_started = true;
    for (std::size_t i = 2000; i < ticks.size(); i += 100)
      PALPATE_CHECK((*writer)->append(std::span(ticks).subspan(i, 100)));
  });
  for (int ms = 0; !*is_started && ms < 60'000; ++ms) ::usleep(1000);
  const auto source = RecordingSource::open(folder / "run.h5");
  ASSERT_TRUE(source) << source.error().message();
  const auto known = source->head().ticks;
  ASSERT_GE(known, 1000u);
  for (std::uint64_t first = 0; first + 100 <= known; first += 250) {
    const auto read = source->read_at(first, 100);
    EXPECT_TRUE(read) << read.error().message();
    if (read)
      expect_same(*read, {ticks.begin() + static_cast<std::ptrdiff_t>(first),
                          ticks.begin() + static_cast<std::ptrdiff_t>(first + 100)});
  }
  EXPECT_TRUE(recorder.finished());
}

TEST(Recording, IsFlushedAfterASecondOnASlowClock) {
  // a real clock that reaches 300 of its nominal 1000 ticks per second
  const test::TemporaryFolder folder;
  auto ticks = test::example_ticks(1700, 1, 300);
  auto writer = RecordingWriter::create(folder / "run.h5", test::example_header(1, 1000));
  ASSERT_TRUE(writer);
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    ASSERT_TRUE((*writer)->append(std::span(ticks).subspan(i, 1)));
    if (i % 157 != 0) continue;
    const auto read = read_recording(folder / "run.h5");
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_LE(i + 1 - (*read).ticks.size(), 301u);
  }
  ASSERT_TRUE((*writer)->finish(test::example_summary(ticks.size())));
  const auto read = read_recording(folder / "run.h5");
  ASSERT_TRUE(read) << read.error().message();
  expect_same((*read).ticks, ticks);
}

// Not under AddressSanitizer: the reader forks, and if another thread holds a lock of the sanitizer's
// allocator it stays locked in the child. glibc's malloc handles that.
#ifndef __SANITIZE_ADDRESS__
TEST(Recording, ReadsFromThreadsWhileOthersWrite) {
  // no other thread may be inside HDF5 while the reader forks
  const test::TemporaryFolder folder;
  const auto ticks = test::example_ticks(400, 1, 100);
  write_recording(folder / "done.h5", test::example_header(1, 100), ticks);
  std::atomic<bool> stop = false;
  std::thread recorder([&] {
    while (!stop) write_recording(folder / "other.h5", test::example_header(1, 100), ticks);
  });
  for (int i = 0; i < 20; ++i) {
    const auto read = read_recording(folder / "done.h5");
    EXPECT_TRUE(read) << read.error().message();
  }
  stop = true;
  recorder.join();
}
#endif

TEST(Recording, ReportsProgressAndStops) {
  const test::TemporaryFolder folder;
  write_recording(folder / "run.h5", test::example_header(1, 10000), test::example_ticks(20000, 1, 10000));
  double last = -1;
  std::atomic<bool> stop = false;
  const Progress progress(
      [&](std::string_view, double fraction) {
        EXPECT_GT(fraction, last);
        EXPECT_LE(fraction, 1);
        last = fraction;
        if (fraction > 0.5) stop = true;
      },
      &stop);
  const auto read = read_recording(folder / "run.h5", progress);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().kind, ErrorKind::kInterrupted);
  EXPECT_GT(last, 0.5);
}

TEST(RunHash, DependsOnEveryStateAndOnTheirOrder) {
  const auto of = [](std::initializer_list<std::uint64_t> states) {
    std::uint64_t hash = 0;
    for (const std::uint64_t state : states) hash = mix_run_hash(hash, state);
    return hash;
  };
  EXPECT_NE(of({1, 2}), of({2, 1}));
  EXPECT_NE(of({0}), of({0, 0}));
  EXPECT_NE(of({5, 6, 7}), of({5, 6, 8}));
  // pinned, because hashes in existing recordings must remain valid
  EXPECT_EQ(of({1, 2, 3}), 5880516937824699343u);
}

TEST(Recording, TellsTheFirstOutputThatDiffers) {
  DeviceTick recorded;
  recorded.force_N = {1, 2, 3};
  recorded.contact_label = {7, 9};
  recorded.contact_N = {0.5, 0.25};
  EXPECT_EQ(first_different_output(recorded, recorded), "");
  DeviceTick again = recorded;
  // inputs are not compared
  again.tip_world_mm = {1, 1, 1};
  EXPECT_EQ(first_different_output(recorded, again), "");
  again.contact_N[1] = 0.5;
  EXPECT_EQ(first_different_output(recorded, again),
            "contact_N: recorded 0.5 0.25 0 0 0 0, now 0.5 0.5 0 0 0 0");
  again.contact_label[1] = 8;
  EXPECT_EQ(first_different_output(recorded, again), "contact_label: recorded 7 9 0 0 0 0, now 7 8 0 0 0 0");
  again.contact_label = recorded.contact_label;
  again.contact_N = recorded.contact_N;
  again.flags = kFlagContact;
  EXPECT_EQ(first_different_output(recorded, again), "flags: recorded 0, now 16");
  recorded.force_N = {};
  EXPECT_EQ(first_different_output(recorded, again), "force_N: recorded 0 0 0, now 1 2 3");
}

}  // namespace
}  // namespace palpate
