// Damaged, foreign and malicious recordings.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "base/test_seed.h"
#include "palpate/recording/recorder.h"
#include "recording/columns.h"
#include "recording/hdf5_handle.h"
#include "recording/header_fields.h"
#include "recording/stream.h"
#include "recording/test_support.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using internal::Handle;
using ::testing::HasSubstr;

constexpr std::size_t kTicks = 20;

class Hostile : public ::testing::Test {
 protected:
  // a small complete recording
  void SetUp() override {
    auto writer = RecordingWriter::create(file_, test::example_header(1, 8));
    ASSERT_TRUE(writer);
    ASSERT_TRUE((*writer)->append(test::example_ticks(kTicks, 1, 8), test::example_events()));
    ASSERT_TRUE((*writer)->finish(test::example_summary(kTicks)));
    bytes_ = test::read_bytes(file_);
  }

  // error of reading a fresh copy that was modified by `change` through HDF5
  std::string error_after(const std::function<void(hid_t file)>& change) {
    test::write_bytes(file_, bytes_);
    {
      const internal::Hdf5Section section;
      const Handle file(H5Fopen(file_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), H5Fclose);
      EXPECT_TRUE(file.ok());
      change(file.get());
    }
    const auto read = read_recording(file_);
    if (read) return "no error";
    EXPECT_EQ(read.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(read.error().where, file_.string());
    return read.error().what;
  }

  static void set_attribute(hid_t object, const char* name, hid_t type, const void* value) {
    H5Adelete(object, name);
    const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
    const Handle made(H5Acreate2(object, name, type, space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    EXPECT_GE(H5Awrite(made.get(), type, value), 0);
  }
  static void set_header(hid_t file, const char* name, hid_t type, const void* value) {
    const Handle header(H5Gopen2(file, "header", H5P_DEFAULT), H5Gclose);
    set_attribute(header.get(), name, type, value);
  }
  static Handle string_type(std::size_t size) {
    Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(type.get(), size);
    return type;
  }
  // replaces a data set by an empty one
  static void replace(hid_t file, const char* name, hid_t type, std::vector<hsize_t> dims,
                      std::vector<hsize_t> chunk = {}, const Handle* properties = nullptr) {
    H5Ldelete(file, name, H5P_DEFAULT);
    const int rank = static_cast<int>(dims.size());
    const Handle space(H5Screate_simple(rank, dims.data(), nullptr), H5Sclose);
    const Handle own(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    if (chunk.empty()) H5Pset_alloc_time(own.get(), H5D_ALLOC_TIME_EARLY);
    const Handle& used = properties != nullptr ? *properties : own;
    if (!chunk.empty()) H5Pset_chunk(used.get(), rank, chunk.data());
    const Handle made(H5Dcreate2(file, name, type, space.get(), H5P_DEFAULT, used.get(), H5P_DEFAULT),
                      H5Dclose);
    EXPECT_TRUE(made.ok());
  }

  test::TemporaryFolder folder_;
  fs::path file_ = folder_ / "run.h5";
  std::vector<std::byte> bytes_;
};

TEST_F(Hostile, ChangedShapesAndTypesAreNamed) {
  EXPECT_EQ(error_after([](hid_t) {}), "no error");
  EXPECT_THAT(error_after([](hid_t f) { H5Ldelete(f, "ticks/dt_s", H5P_DEFAULT); }),
              HasSubstr("/ticks/dt_s is missing"));
  EXPECT_THAT(error_after([](hid_t f) { H5Ldelete(f, "device0", H5P_DEFAULT); }),
              HasSubstr("no group /device0"));
  EXPECT_THAT(error_after([](hid_t f) { H5Ldelete(f, "summary", H5P_DEFAULT); }),
              HasSubstr("no group /summary"));
  const auto with = [&](const char* name, hid_t type, std::vector<hsize_t> dims) {
    return error_after([&](hid_t f) { replace(f, name, type, dims); });
  };
  EXPECT_THAT(with("ticks/dt_s", H5T_IEEE_F32LE, {kTicks}), HasSubstr("/ticks/dt_s has another type"));
  EXPECT_THAT(with("ticks/tick", H5T_STD_I64LE, {kTicks}), HasSubstr("another type"));
  EXPECT_THAT(with("ticks/tick", H5T_IEEE_F64LE, {kTicks}), HasSubstr("another type"));
  EXPECT_THAT(with("ticks/dt_s", H5T_IEEE_F64LE, {kTicks, 1}), HasSubstr("/ticks/dt_s has another shape"));
  EXPECT_THAT(with("device0/force_N", H5T_IEEE_F64LE, {kTicks, 2}), HasSubstr("another shape"));
  EXPECT_THAT(with("device0/force_N", H5T_IEEE_F64LE, {kTicks, 3, 1}), HasSubstr("another shape"));
  EXPECT_THAT(with("device0/force_N", H5T_IEEE_F64LE, {}), HasSubstr("another shape"));
  EXPECT_THAT(with("structures/label", H5T_STD_U16LE, {1}), HasSubstr("another length"));
  EXPECT_THAT(with("structures/name", H5T_STD_U16LE, {2}), HasSubstr("not a text"));
  EXPECT_THAT(with("header/script", H5T_STD_U64LE, {}), HasSubstr("not a text"));
  EXPECT_THAT(with("summary/ticks", H5T_STD_U64LE, {2}), HasSubstr("another shape"));
  EXPECT_THAT(with("summary/trouble", H5T_STD_U64LE, {2}), HasSubstr("not a text"));
  EXPECT_THAT(with("summary/trouble", string_type(8).get(), {2, 2}), HasSubstr("another shape"));
  EXPECT_THAT(with("summary/trouble", string_type(8).get(), {1001}), HasSubstr("too many problems"));
  EXPECT_THAT(with("summary/trouble", string_type(9000).get(), {1}), HasSubstr("not a text"));
  EXPECT_EQ(with("summary/trouble", string_type(8).get(), {1}), "no error");
  EXPECT_THAT(error_after([](hid_t f) { H5Ldelete(f, "summary/trouble", H5P_DEFAULT); }),
              HasSubstr("/summary/trouble is missing"));
  EXPECT_THAT(error_after([](hid_t f) { H5Ldelete(f, "events", H5P_DEFAULT); }),
              HasSubstr("no group /events"));
  EXPECT_THAT(with("events/tick", H5T_STD_U32LE, {2}), HasSubstr("/events/tick has another type"));
  EXPECT_THAT(with("events/tick", H5T_STD_U64LE, {3}), HasSubstr("another length"));
  EXPECT_THAT(with("events/tick", H5T_STD_U64LE, {2, 2}), HasSubstr("another shape"));
  EXPECT_THAT(with("events/rotation_target_wxyz", H5T_IEEE_F64LE, {2, 3}), HasSubstr("another shape"));
  const Handle endless(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(endless.get(), H5T_VARIABLE);
  EXPECT_THAT(with("header/script", endless.get(), {}), HasSubstr("not a text"));
  const Handle huge = string_type(std::size_t{1} << 31);
  EXPECT_THAT(with("header/script", huge.get(), {}), HasSubstr("not a text"));
}

/// A range may be read from a file that has changed since it was opened.
TEST_F(Hostile, RejectsGapsInARange) {
  const auto source = RecordingSource::open(file_);
  ASSERT_TRUE(source) << source.error().message();
  ASSERT_TRUE(source->read_at(0, kTicks));
  constexpr hsize_t kChunk = 4;
  EXPECT_THAT(
      error_after([](hid_t f) {
        replace(f, "ticks/dt_s", H5T_IEEE_F64LE, {kTicks}, {kChunk});
        // all chunks but the first
        const std::vector<double> values(kTicks, 0.125);
        const Handle column(H5Dopen2(f, "ticks/dt_s", H5P_DEFAULT), H5Dclose);
        const Handle space(H5Dget_space(column.get()), H5Sclose);
        const hsize_t first = kChunk, count = kTicks - kChunk;
        H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, &first, nullptr, &count, nullptr);
        const Handle memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
        EXPECT_GE(
            H5Dwrite(column.get(), H5T_IEEE_F64LE, memory.get(), space.get(), H5P_DEFAULT, values.data()), 0);
      }),
      HasSubstr("has gaps"));
  // the stored rows can be read
  const auto stored = source->read_at(kChunk, kTicks - kChunk);
  ASSERT_TRUE(stored) << stored.error().message();
  EXPECT_EQ(stored->front().dt_s, 0.125);
  for (const std::uint64_t first : {0u, 3u}) {
    const auto read = source->read_at(first, 2);
    ASSERT_FALSE(read) << first;
    EXPECT_THAT(read.error().what, HasSubstr("/ticks/dt_s has gaps"));
  }
}

TEST_F(Hostile, LengthsThatTheFileCannotHoldAreRefused) {
  const auto with = [&](std::vector<hsize_t> dims, std::vector<hsize_t> chunk) {
    return error_after([&](hid_t f) { replace(f, "ticks/dt_s", H5T_IEEE_F64LE, dims, chunk); });
  };
  EXPECT_THAT(with({hsize_t{1} << 40}, {1024}), HasSubstr("longer than the file can hold"));
  EXPECT_THAT(with({kTicks}, {8}), HasSubstr("has gaps"));
  EXPECT_THAT(with({hsize_t{1} << 27}, {hsize_t{1} << 27}), HasSubstr("chunks of another shape"));
  EXPECT_THAT(error_after([](hid_t f) {
                const Handle never_stored(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
                replace(f, "ticks/dt_s", H5T_IEEE_F64LE, {kTicks}, {}, &never_stored);
              }),
              HasSubstr("has gaps"));
  // a complete run has columns of equal length, and as many ticks as it declares
  EXPECT_THAT(error_after([](hid_t f) {
                const Handle column(H5Dopen2(f, "device0/depth_mm", H5P_DEFAULT), H5Dclose);
                const hsize_t fewer = kTicks - 1;
                H5Dset_extent(column.get(), &fewer);
              }),
              HasSubstr("/device0/depth_mm has another length"));
  EXPECT_THAT(error_after([](hid_t f) {
                const Handle ticks(H5Dopen2(f, "summary/ticks", H5P_DEFAULT), H5Dclose);
                const std::uint64_t more = kTicks + 1;
                H5Dwrite(ticks.get(), H5T_STD_U64LE, H5S_ALL, H5S_ALL, H5P_DEFAULT, &more);
              }),
              HasSubstr("counts 21 ticks, but the data sets have 20"));
}

TEST_F(Hostile, HeadersAreChecked) {
  const double nan = std::nan(""), negative = -1, infinite = std::numeric_limits<double>::infinity();
  for (const double* rate : {&nan, &negative, &infinite})
    EXPECT_THAT(error_after([&](hid_t f) { set_header(f, "rate_hz", H5T_IEEE_F64LE, rate); }),
                HasSubstr("rate"));
  for (const std::uint32_t devices : {0u, 5u, 4'000'000'000u})
    EXPECT_THAT(error_after([&](hid_t f) { set_header(f, "devices", H5T_STD_U32LE, &devices); }),
                HasSubstr("names " + std::to_string(devices) + " devices"));
  const std::uint32_t two = 2;
  EXPECT_THAT(error_after([&](hid_t f) { set_header(f, "devices", H5T_STD_U32LE, &two); }),
              HasSubstr("no group /device1"));
  EXPECT_THAT(error_after([&](hid_t f) { set_header(f, "seed", H5T_STD_U32LE, &two); }),
              HasSubstr("seed has another type"));
  const std::string text(9000, 'x');
  EXPECT_THAT(error_after([&](hid_t f) { set_header(f, "hand", string_type(9000).get(), text.data()); }),
              HasSubstr("hand"));
  EXPECT_THAT(error_after([&](hid_t f) { set_header(f, "clock", string_type(7).get(), "sundial"); }),
              HasSubstr("clock is neither virtual nor real"));
  const std::uint32_t newer = internal::kFormatMajor + 1, minor = 77;
  EXPECT_THAT(error_after([&](hid_t f) { set_attribute(f, "format_major", H5T_STD_U32LE, &newer); }),
              HasSubstr("written by a newer palpate: format " + std::to_string(newer)));
  EXPECT_EQ(error_after([&](hid_t f) { set_attribute(f, "format_minor", H5T_STD_U32LE, &minor); }),
            "no error");
  EXPECT_THAT(error_after([&](hid_t f) { set_attribute(f, "format", string_type(3).get(), "abc"); }),
              HasSubstr("not a recording of palpate"));
}

TEST_F(Hostile, AColumnMayBeAbsentFromOlderRecordingsOnly) {
  const auto without = [&](std::uint32_t minor, const char* column) {
    return error_after([&](hid_t f) {
      set_attribute(f, "format_minor", H5T_STD_U32LE, &minor);
      H5Ldelete(f, column, H5P_DEFAULT);
    });
  };
  EXPECT_EQ(without(0, "device0/kick_N"), "no error");
  EXPECT_THAT(without(1, "device0/kick_N"), HasSubstr("kick_N is missing"));
  EXPECT_THAT(without(0, "device0/force_N"), HasSubstr("force_N is missing"));
}

TEST_F(Hostile, AnEarlierFormatIsOneClearError) {
  test::write_bytes(file_, bytes_);
  {
    // without fields and columns that such a file does not have
    const internal::Hdf5Section section;
    const Handle file(H5Fopen(file_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), H5Fclose);
    const std::uint32_t earlier = 5;
    set_attribute(file.get(), "format_major", H5T_STD_U32LE, &earlier);
    const Handle header(H5Gopen2(file.get(), "header", H5P_DEFAULT), H5Gclose);
    H5Adelete(header.get(), "clock");
    H5Ldelete(file.get(), "device0/force_gain", H5P_DEFAULT);
  }
  const auto read = read_recording(file_);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(read.error().where, file_.string());
  EXPECT_EQ(read.error().what, "was made by an earlier palpate (format 5; this one reads format 6)");
  EXPECT_EQ(read.error().remedy, "record it again");
}

TEST_F(Hostile, SweepsAreOfShapesThatABurrHas) {
  const auto ticks = test::example_ticks(kTicks, 1, 8);
  const SweepRecord ball{0, {1, 2, 3}, {1, 2, 3.2}, 2, 1};
  SweepRecord cone = ball;
  cone.axis_mm = {0, -4, 3};
  cone.end_radius_mm = 1.25;
  const auto written = [&](const std::vector<SweepRecord>& sweeps) {
    std::vector<RecordingEvent> events;
    for (const SweepRecord& sweep : sweeps) {
      RecordingEvent& event = events.emplace_back();
      event.kind = RecordingEvent::Kind::kSweep;
      event.tick = 1;
      event.number = 2;
      event.sweep = sweep;
    }
    auto writer = RecordingWriter::create(file_, test::example_header(1, 8));
    ASSERT_TRUE(writer);
    ASSERT_TRUE((*writer)->append(ticks, events));
    ASSERT_TRUE((*writer)->finish(test::example_summary(kTicks)));
  };
  const auto read_sweeps = [&] {
    const auto read = read_recording(file_);
    EXPECT_TRUE(read) << read.error().message();
    std::vector<SweepRecord> sweeps;
    if (read)
      for (const RecordingEvent& event : read->events) sweeps.push_back(event.sweep);
    return sweeps;
  };
  written({ball, cone});
  EXPECT_EQ(read_sweeps(), (std::vector<SweepRecord>{ball, cone}));
  // values that no burr produces
  SweepRecord endless = cone, pointed = cone, unknown = cone, twofold = ball;
  endless.axis_mm[0] = 1e5;
  pointed.end_radius_mm = 0;
  unknown.axis_mm[2] = kNoValue;
  twofold.end_radius_mm = 1;
  for (const SweepRecord& none : {endless, pointed, unknown, twofold}) {
    written({none});
    const auto read = read_recording(file_);
    ASSERT_FALSE(read);
    EXPECT_THAT(read.error().what, HasSubstr("a sweep is invalid"));
  }
}

TEST_F(Hostile, DamagedEventsAreRejected) {
  const auto with = [&](const char* name, hid_t type, const void* values) {
    return error_after([&](hid_t f) {
      const Handle column(H5Dopen2(f, name, H5P_DEFAULT), H5Dclose);
      EXPECT_GE(H5Dwrite(column.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), 0);
    });
  };
  const std::uint64_t backwards[] = {7, 3}, late[] = {3, 1'000'000};
  EXPECT_THAT(with("events/tick", H5T_STD_U64LE, backwards), HasSubstr("events are out of order"));
  EXPECT_EQ(with("events/tick", H5T_STD_U64LE, late), "no error") << "of no tick that is there";
  const std::uint8_t wild[] = {1, 9};
  EXPECT_THAT(with("events/kind", H5T_STD_U8LE, wild), HasSubstr("unknown kind"));
  EXPECT_THAT(with("events/requested_by", H5T_STD_U8LE, wild), HasSubstr("unknown source"));
}

TEST_F(Hostile, NothingIsReadFromOtherFiles) {
  const auto other = (folder_ / "other.h5").string();
  test::write_bytes(other, bytes_);
  const auto dt_s = "ticks/dt_s";
  EXPECT_THAT(error_after([&](hid_t f) {
                H5Ldelete(f, dt_s, H5P_DEFAULT);
                H5Lcreate_external(other.c_str(), "/ticks/dt_s", f, dt_s, H5P_DEFAULT, H5P_DEFAULT);
              }),
              HasSubstr("/ticks/dt_s is missing"));
  EXPECT_THAT(error_after([&](hid_t f) {
                H5Ldelete(f, "ticks", H5P_DEFAULT);
                H5Lcreate_external(other.c_str(), "/ticks", f, "ticks", H5P_DEFAULT, H5P_DEFAULT);
              }),
              HasSubstr("no group /ticks"));
  EXPECT_THAT(error_after([&](hid_t f) {
                const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
                H5Pset_external(properties.get(), other.c_str(), 0, 8 * kTicks);
                replace(f, dt_s, H5T_IEEE_F64LE, {kTicks}, {}, &properties);
              }),
              HasSubstr("stored in another file"));
  EXPECT_THAT(error_after([&](hid_t f) {
                const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
                const hsize_t rows = kTicks;
                const Handle space(H5Screate_simple(1, &rows, nullptr), H5Sclose);
                H5Pset_virtual(properties.get(), space.get(), other.c_str(), "/ticks/dt_s", space.get());
                replace(f, dt_s, H5T_IEEE_F64LE, {kTicks}, {}, &properties);
              }),
              HasSubstr("stored in another file"));
}

TEST_F(Hostile, DistinguishesForeignFiles) {
  const auto error_of = [&](const fs::path& file) {
    const auto read = read_recording(file);
    if (read) return std::string("no error");
    EXPECT_EQ(read.error().kind, ErrorKind::kBadInput);
    return read.error().what;
  };
  EXPECT_EQ(error_of(folder_ / "missing.h5"), "no such file");
  EXPECT_THAT(error_of(folder_ / ""), HasSubstr("is a folder"));
  ASSERT_EQ(::mkfifo((folder_ / "fifo").c_str(), 0600), 0);
  EXPECT_THAT(error_of(folder_ / "fifo"), HasSubstr("is a pipe"));
  test::write_bytes(folder_ / "empty", {});
  EXPECT_THAT(error_of(folder_ / "empty"), HasSubstr("not an HDF5 file"));
  const std::string text(5000, '#');
  test::write_bytes(folder_ / "text", std::as_bytes(std::span(text)));
  EXPECT_THAT(error_of(folder_ / "text"), HasSubstr("not an HDF5 file"));
  {
    const internal::Hdf5Section section;
    const Handle other(H5Fcreate((folder_ / "other.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
                       H5Fclose);
  }
  EXPECT_THAT(error_of(folder_ / "other.h5"), HasSubstr("not a recording of palpate"));
  // HDF5's format permits a user block in front
  std::vector<std::byte> prefixed(512);
  prefixed.insert(prefixed.end(), bytes_.begin(), bytes_.end());
  test::write_bytes(folder_ / "prefixed.h5", prefixed);
  EXPECT_EQ(error_of(folder_ / "prefixed.h5"), "no error");
}

TEST_F(Hostile, TruncatedFilesAreOneClearError) {
  std::size_t steps = 0;
  for (std::size_t size = 0; size < bytes_.size(); size += 1 + bytes_.size() / 61, ++steps) {
    SCOPED_TRACE("first " + std::to_string(size) + " bytes");
    test::write_bytes(file_, std::span(bytes_).first(size));
    const auto read = read_recording(file_);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().kind, ErrorKind::kBadInput);
    EXPECT_THAT(read.error().what, ::testing::AnyOf(HasSubstr("damaged"), HasSubstr("not an HDF5 file")));
  }
  EXPECT_GE(steps, 60u);
}

TEST_F(Hostile, FlippedBytesNeverCrash) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  int refused = 0;
  for (int round = 0; round < 150; ++round) {
    auto bytes = bytes_;
    for (std::uint64_t flips = 1 + random() % 8; flips > 0; --flips)
      bytes[random() % bytes.size()] = static_cast<std::byte>(random());
    test::write_bytes(file_, bytes);
    const auto read = read_recording(file_);
    if (read) continue;  // the flipped bit is in row data
    EXPECT_EQ(read.error().kind, ErrorKind::kBadInput);
    EXPECT_FALSE(read.error().what.empty());
    ++refused;
  }
  EXPECT_GT(refused, 15);
}

Result<Recording> receive(std::span<const std::byte> bytes) {
  test::MemorySource source(bytes);
  return test::receive_all(source);
}

TEST(Stream, EndsAreNoticedAtEveryByte) {
  test::MemoryTarget sent;
  const auto header = test::example_header(1);
  ASSERT_TRUE(internal::send_head(sent, {header, test::example_summary(0), 0, true, {{5, 0}, {1, 7}}}));
  for (std::size_t size = 0; size < sent.bytes.size(); ++size)
    EXPECT_FALSE(receive(std::span(sent.bytes).first(size))) << size;
  const auto whole = receive(sent.bytes);
  ASSERT_TRUE(whole) << whole.error().message();
  EXPECT_EQ(test::first_difference((*whole).header, header), "");
  ASSERT_TRUE((*whole).summary);
  EXPECT_EQ((*whole).summary->problems, test::example_summary(0).problems);
}

// stream of a few ticks with their events
std::vector<std::byte> stream_of(const std::vector<TickRecord>& ticks,
                                 const std::vector<RecordingEvent>& events, const RecordingHead& head) {
  test::MemoryTarget sent;
  EXPECT_TRUE(internal::send_head(sent, head));
  EXPECT_TRUE(internal::send_events(sent, events, static_cast<std::uint32_t>(ticks.size())));
  const auto put = [&](const internal::Column& column, const auto& record_of) {
    for (const TickRecord& tick : ticks) {
      const auto* first = reinterpret_cast<const std::byte*>(record_of(tick)) + column.offset;
      EXPECT_TRUE(sent.write({first, column.row_bytes()}));
    }
  };
  for (const auto& column : internal::tick_columns())
    put(column, [](const TickRecord& tick) { return &tick; });
  for (const auto& column : internal::device_columns())
    put(column, [](const TickRecord& tick) { return &tick.device[0]; });
  return sent.bytes;
}

TEST(Stream, BelievesNoPart) {
  const auto ticks = test::example_ticks(3, 1, 1000);
  const RecordingHead head{test::example_header(1), {}, 3, true, {{0, 0}}};
  const auto error_of = [](const std::vector<std::byte>& bytes) {
    const auto read = receive(bytes);
    return read ? std::string("no error") : read.error().what;
  };
  EXPECT_EQ(error_of(stream_of(ticks, test::example_events(), head)), "no error");
  // inconsistent declarations in the head
  RecordingHead other = head;
  other.methods = {{1, 0}};
  EXPECT_THAT(error_of(stream_of(ticks, {}, other)), HasSubstr("its ticks contradict its header"));
  auto standing = ticks;
  standing[2].time_s = standing[1].time_s;
  EXPECT_THAT(error_of(stream_of(standing, {}, head)), HasSubstr("its ticks contradict its header"));
  other = head;
  other.is_clock_monotonic = false;
  EXPECT_EQ(error_of(stream_of(standing, {}, other)), "no error");
  // more ticks than declared, more events than a part may hold, empty parts without end
  other = head;
  other.ticks = 2;
  EXPECT_THAT(error_of(stream_of(ticks, {}, other)), HasSubstr("an invalid size"));
  EXPECT_THAT(error_of(stream_of(ticks, std::vector<RecordingEvent>(4097), head)),
              HasSubstr("an invalid size"));
  EXPECT_THAT(error_of(stream_of({}, {}, head)), HasSubstr("an invalid size"));
}

TEST(Stream, DeclaredRowCountAllocatesNothing) {
  test::MemoryTarget sent;
  ASSERT_TRUE(
      internal::send_head(sent, {test::example_header(4), std::nullopt, std::uint64_t{1} << 60, true, {}}));
  const auto read = receive(sent.bytes);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().what, "ended");
}

TEST(Stream, BelievesNoHeader) {
  const auto error_of = [](auto&& change) {
    RecordingHead head{test::example_header(1), test::example_summary(0), 0, true, {}};
    change(head);
    test::MemoryTarget sent;
    EXPECT_TRUE(internal::send_head(sent, head));
    const auto read = receive(sent.bytes);
    return read ? std::string("no error") : read.error().what;
  };
  EXPECT_THAT(error_of([](auto& head) { head.header.devices = 0; }), HasSubstr("names 0 devices"));
  EXPECT_THAT(error_of([](auto& head) { head.header.devices = 5; }), HasSubstr("names 5 devices"));
  EXPECT_THAT(error_of([](auto& head) { head.header.rate_hz = std::nan(""); }), HasSubstr("rate"));
  EXPECT_THAT(error_of([](auto& head) { head.header.clock = "sundial"; }), HasSubstr("clock"));
  EXPECT_THAT(error_of([](auto& head) { head.header.hand = std::string(9000, 'x'); }), HasSubstr("too long"));
  EXPECT_THAT(error_of([](auto& head) { head.header.structures.resize(70000); }),
              HasSubstr("too many structures"));
  EXPECT_THAT(error_of([](auto& head) { head.summary->problems.resize(1001); }),
              HasSubstr("too many problems"));
  EXPECT_THAT(error_of([](auto& head) { head.summary->problems = {std::string(9000, 'x')}; }),
              HasSubstr("too long"));
  EXPECT_THAT(error_of([](auto& head) { head.methods.resize(257); }), HasSubstr("too many methods"));
  EXPECT_THAT(error_of([](auto& head) { head.summary->ticks = 1; }), HasSubstr("counts 1 ticks"));
}

TEST(Stream, RefusalsArriveAsPlainText) {
  test::MemoryTarget sent;
  ASSERT_TRUE(
      internal::send_refusal(sent, {ErrorKind::kBadInput, "bad \x1b[31mred, ~1 mm", "", "try\nthis"}));
  const auto read = receive(sent.bytes);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().what, "bad ?[31mred, ~1 mm");
  EXPECT_EQ(read.error().remedy, "try?this");
  // found by the fuzzer
  test::MemoryTarget silent;
  ASSERT_TRUE(internal::send_refusal(silent, {ErrorKind::kBadInput, "", "", ""}));
  EXPECT_THAT(receive(silent.bytes).error().what, HasSubstr("HDF5 fails to read it"));
}

}  // namespace
}  // namespace palpate
