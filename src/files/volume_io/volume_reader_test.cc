#include "volume_io/volume_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "base/test_files.h"
#include "reader/test_confine.h"
#include "reader/test_leaks.h"
#include "volume/test_grids.h"

namespace palpate::volume_io {
namespace {

using test::TemporaryFolder;
using test::write_text;
using ::testing::HasSubstr;

// more pieces than slots
constexpr int kSide = 128;
std::string header(const std::string& more) {
  const std::string side = std::to_string(kSide);
  return "NRRD0004\ntype: uint8\ndimension: 3\nspace: LPS\nsizes: " + side + " " + side + " " + side +
         "\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: raw\n" + more + "\n";
}
std::string voxels() {
  std::string bytes(std::size_t{kSide} * kSide * kSide, '\0');
  for (std::size_t n = 0; n < bytes.size(); ++n) bytes[n] = static_cast<char>(n * 2654435761u >> 24);
  return bytes;
}

// child processes of this process that have not been reaped
std::vector<pid_t> children() {
  const std::string self = std::to_string(::getpid());
  std::ifstream file("/proc/" + self + "/task/" + self + "/children");
  std::vector<pid_t> found;
  for (pid_t id = 0; file >> id;) found.push_back(id);
  return found;
}
std::string status_line(pid_t process, const std::string& name) {
  std::ifstream file("/proc/" + std::to_string(process) + "/status");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with(name + ":\t")) return line.substr(name.size() + 2);
  return "";
}

class VolumeReaderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    write_text(file_, header("") + voxels());
    before_ = test::open_descriptors();
  }
  void TearDown() override {
    EXPECT_EQ(test::open_descriptors(), before_);
    EXPECT_TRUE(test::has_no_child());
  }

  // result of streaming if `meanwhile` is called after the first piece
  Result<void> stream_with(const Progress& progress, const std::function<void()>& meanwhile) const {
    auto reader = VolumeReader::open(file_, progress);
    if (!reader) return reader.error();
    return reader->stream([&](std::uint64_t first, std::span<const std::byte>) -> Result<void> {
      if (first == 0) meanwhile();
      return {};
    });
  }

  const Progress silent_;
  const TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "v.nrrd";

 private:
  std::size_t before_ = 0;
};

TEST_F(VolumeReaderTest, StreamsEveryValueAsOftenAsItIsAsked) {
  auto reader = VolumeReader::open(file_, silent_);
  ASSERT_TRUE(reader) << reader.error().message();
  EXPECT_EQ(reader->file().header.format, "NRRD");
  EXPECT_EQ(reader->file().header.component_type, "uint8");
  const std::string whole = voxels();
  for (int time = 0; time < 3; ++time) {
    std::string received;
    const auto read =
        reader->stream([&](std::uint64_t first, std::span<const std::byte> values) -> Result<void> {
          EXPECT_EQ(first, received.size());
          received.append(reinterpret_cast<const char*>(values.data()), values.size());
          return {};
        });
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_TRUE(received == whole) << time;
  }
}

TEST_F(VolumeReaderTest, HeaderAndVoxelsAreReadByAConfinedProcess) {
  std::vector<pid_t> reading;
  std::string filtered, privileges;
  const auto read = stream_with(silent_, [&] {
    reading = children();
    if (reading.size() != 1) return;
    filtered = status_line(reading[0], "Seccomp");
    privileges = status_line(reading[0], "NoNewPrivs");
  });
  ASSERT_TRUE(read) << read.error().message();
  ASSERT_EQ(reading.size(), 1u);
  if (reader::sanitized()) return;
  EXPECT_EQ(privileges, "1");
  EXPECT_EQ(filtered, reader::can_restrict_system_calls() ? "2" : "0");
}

TEST_F(VolumeReaderTest, AReaderThatDiesIsOneError) {
  const auto read = stream_with(silent_, [] {
    for (const pid_t reading : children()) ::kill(reading, SIGSEGV);
  });
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().message(),
            file_.string() + ": is damaged: its reader fails to read it\n  copy or download it again");
}

TEST_F(VolumeReaderTest, AnInterruptEndsAReaderThatStandsStill) {
  std::atomic<bool> stop = false;
  const Progress progress({}, &stop);
  const auto read = stream_with(progress, [&] {
    for (const pid_t reading : children()) ::kill(reading, SIGSTOP);
    stop = true;
  });
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().kind, ErrorKind::kInterrupted);
}

TEST_F(VolumeReaderTest, ATakersErrorEndsIt) {
  auto reader = VolumeReader::open(file_, silent_);
  ASSERT_TRUE(reader);
  const auto read = reader->stream([](std::uint64_t, std::span<const std::byte>) -> Result<void> {
    return Error{ErrorKind::kBadInput, "enough", "", ""};
  });
  EXPECT_EQ(read.error().what, "enough");
  EXPECT_TRUE(test::has_no_child());
}

TEST_F(VolumeReaderTest, AnotherFileUnderTheNameIsNotRead) {
  if (reader::sanitized()) return;
  if (!reader::can_restrict_files())
    GTEST_SKIP() << "this kernel has no Landlock: what stands under the name is read";
  auto reader = VolumeReader::open(file_, silent_);
  ASSERT_TRUE(reader);
  std::filesystem::rename(write_text(folder_ / "other", header("") + std::string(voxels().size(), 'x')),
                          file_);
  const auto read = reader->stream([](std::uint64_t, std::span<const std::byte>) { return Result<void>(); });
  ASSERT_FALSE(read);
  EXPECT_THAT(read.error().message(), HasSubstr(file_.string() + ": cannot be read"));
}

TEST_F(VolumeReaderTest, ItReadsTheOtherFileOnlyWhereTheParentFindsIt) {
  write_text(folder_ / "v.raw", voxels());
  const auto pair = write_text(folder_ / "pair.nhdr", header("data file: v.raw\n"));
  {
    auto reader = VolumeReader::open(pair, silent_);
    ASSERT_TRUE(reader) << reader.error().message();
    EXPECT_EQ(reader->file().voxels.file, folder_ / "v.raw");
    EXPECT_TRUE(reader->stream([](std::uint64_t, std::span<const std::byte>) { return Result<void>(); }));
  }
  write_text(pair, header("data file: ../v.raw\n"));
  EXPECT_THAT(VolumeReader::open(pair, silent_).error().what, HasSubstr("outside its own folder"));
  write_text(pair, header("data file: none.raw\n"));
  EXPECT_THAT(VolumeReader::open(pair, silent_).error().what, HasSubstr("is missing"));
}

TEST_F(VolumeReaderTest, HundredsLeaveNothing) {
  write_text(folder_ / "v.raw", voxels());
  const auto pair = write_text(folder_ / "pair.nhdr", header("data file: v.raw\n"));
  const auto bad = write_text(folder_ / "bad.nrrd", "NRRD0004\ntype: uint8\n\n");
  for (int n = reader::sanitized() ? 90 : 0; n < 100; ++n) {
    ASSERT_TRUE(VolumeReader::open(file_, silent_));
    ASSERT_TRUE(VolumeReader::open(pair, silent_));
    ASSERT_FALSE(VolumeReader::open(bad, silent_));
  }
}

// Result of reading 64 two-byte values from a process that sends these numbers in order.
std::string applied_to(const std::vector<std::uint32_t>& words, const Result<void>* end) {
  const std::vector<std::filesystem::path> files{"v"};
  VolumeFile file;
  file.header.geometry.dims = {4, 4, 4};
  file.voxels.file = "v";
  reader::ReaderProcess::Job job;
  job.shared_bytes = kSlots * kSlotBytes;
  job.death_error = "it died";
  const Progress silent;
  auto process = reader::ReaderProcess::start(
      job,
      [&](reader::ParentEnd& parent) {
        return parent.wait_for_grant() && parent.write(std::as_bytes(std::span(words))) &&
               (end == nullptr || send_end(parent, *end));
      },
      silent);
  PALPATE_CHECK(process.ok());
  std::uint64_t values = 0;
  const auto used =
      read_voxels(**process, file, files, silent, [&](std::uint64_t, std::span<const std::byte> bytes) {
        values += bytes.size() / 2;
        return Result<void>();
      });
  EXPECT_LE(values, 64u);
  return used ? std::to_string(values) : used.error().what;
}

TEST_F(VolumeReaderTest, BelievesNoPiece) {
  const std::string nonsense = "is damaged: its reader reports an impossible volume";
  const Result<void> whole, refused = bad_input("v", "ends early");
  EXPECT_EQ(applied_to({128}, &whole), "64");
  EXPECT_EQ(applied_to({0, 64, 0, 0, 62, 2, 0}, &whole), "64");
  EXPECT_EQ(applied_to({126}, &refused), "ends early");
  // half a value, more values than there are, more than a slot holds
  EXPECT_EQ(applied_to({127}, &whole), nonsense);
  EXPECT_EQ(applied_to({130}, &whole), nonsense);
  EXPECT_EQ(applied_to({128, 2}, &whole), nonsense);
  EXPECT_EQ(applied_to({~std::uint32_t{0} - 1}, &whole), nonsense);
  // end before all values
  EXPECT_EQ(applied_to({126}, &whole), nonsense);
  EXPECT_EQ(applied_to({}, &whole), nonsense);
  EXPECT_EQ(applied_to({128}, nullptr), "it died");
}

TEST_F(VolumeReaderTest, GzipIsDecompressedInTheReaderProcess) {
  // "hello\n"
  constexpr unsigned char kPacked[] = {0x1f, 0x8b, 8,    0, 0, 0,    0,    0,    2,    3, 0xcb, 0x48, 0xcd,
                                       0xc9, 0xc9, 0xe7, 2, 0, 0x20, 0x30, 0x3a, 0x36, 6, 0,    0,    0};
  const auto file =
      write_text(folder_ / "x.gz", std::string(reinterpret_cast<const char*>(kPacked), sizeof kPacked));
  EXPECT_EQ(unpacked_front(file, 4), "hell");
  EXPECT_EQ(unpacked_front(file, 100), "hello\n");
  EXPECT_EQ(unpacked_front(folder_ / "none.gz", 100), "");
}

}  // namespace
}  // namespace palpate::volume_io
