#include "palpate/base/file.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "base/test_child.h"
#include "base/test_files.h"
#include "base/test_folder.h"
#include "palpate/base/output.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

class FileTest : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
};

TEST_F(FileTest, WrittenBytesAreReadBack) {
  const std::string bytes("a\0b\n", 4);
  ASSERT_TRUE(write_file(folder_ / "a.bin", bytes).ok());
  EXPECT_EQ(*read_file(folder_ / "a.bin"), bytes);
  EXPECT_EQ(folder_.count(), 1u);
}

TEST_F(FileTest, OverwriteReplacesTheWholeContent) {
  ASSERT_TRUE(write_file(folder_ / "a", "longer content").ok());
  ASSERT_TRUE(write_file(folder_ / "a", "short").ok());
  EXPECT_EQ(*read_file(folder_ / "a"), "short");
}

TEST_F(FileTest, UncommittedFileIsRemoved) {
  {
    auto pending = PendingFile::create(folder_ / "x.nii.gz");
    ASSERT_TRUE(pending.ok());
    EXPECT_TRUE(pending->path().string().ends_with(".nii.gz"));
    std::ofstream(pending->path()) << "half";
  }
  EXPECT_EQ(folder_.count(), 0u);
}

TEST_F(FileTest, FullDiskIsAnOutputErrorAndKeepsTheOldFile) {
  // the file size limit stands in for a full disk
  ASSERT_TRUE(write_file(folder_ / "a", "old").ok());
  const auto ignored = std::signal(SIGXFSZ, SIG_IGN);
  rlimit before;
  ::getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{1000, before.rlim_max};
  ::setrlimit(RLIMIT_FSIZE, &small);
  const auto result = write_file(folder_ / "a", std::string(5000, 'x'));
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, ignored);
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().kind, ErrorKind::kOutput);
  EXPECT_EQ(*read_file(folder_ / "a"), "old");
  EXPECT_EQ(folder_.count(), 1u);
  EXPECT_NE(output_error("a", ENOSPC).message().find("disk is full"), std::string::npos);
}

TEST_F(FileTest, AbruptExitLeavesNoPartialFile) {
  ASSERT_TRUE(write_file(folder_ / "whole", "x").ok());
  const auto pending = PendingFile::create(folder_ / "pending");
  ASSERT_TRUE(pending.ok());
  const auto claim = OutputClaim::take(folder_ / "claimed");
  ASSERT_TRUE(claim.ok());
  const auto folder = folder_ / "work";
  fs::create_directories(folder / "deeper");
  ASSERT_TRUE(write_file(folder / "deeper" / "part", "x").ok());
  std::optional<UnfinishedFolder> unfinished(folder);
  EXPECT_GT(folder_.count(), 3u);
  abandon_outputs();
  EXPECT_EQ(folder_.count(), 1u);
  EXPECT_EQ(*read_file(folder_ / "whole"), "x");
  // finished output stays
  unfinished.reset();
  fs::create_directories(folder);
  abandon_outputs();
  EXPECT_TRUE(fs::exists(folder));
}

TEST_F(FileTest, DeviceFileIsNotReplaced) {
  const auto result = write_file("/dev/null", "x");
  ASSERT_FALSE(result.ok());
  EXPECT_NE(result.error().what.find("regular file"), std::string::npos);
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(FileTest, MissingFolderNamesTheFolder) {
  const auto result = write_file(folder_ / "missing/a", "x");
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().kind, ErrorKind::kOutput);
  EXPECT_NE(result.error().what.find("does not exist"), std::string::npos);
}

TEST_F(FileTest, ObstructingPathIsNamed) {
  ASSERT_TRUE(write_file(folder_ / "a", "a").ok());
  for (const char* below : {"a/b", "a/b/c"})
    EXPECT_EQ(write_file(folder_ / below, "x").error().where, (folder_ / "a").string());
  const Error error = output_error(folder_ / "a", ENOTDIR);
  EXPECT_NE(error.message().find("/a: is a file, not a folder"), std::string::npos) << error.message();
  // a folder that exists but is not writable is not reported as missing
  EXPECT_NE(write_file("/proc/x.h5", "x").error().what.find("does not accept files"), std::string::npos);
}

TEST_F(FileTest, WriteThroughALinkReplacesItsTarget) {
  ASSERT_TRUE(write_file(folder_ / "target", "old").ok());
  fs::create_symlink("target", folder_ / "link");
  fs::create_symlink(folder_ / "link", folder_ / "second");
  fs::create_symlink("not-yet", folder_ / "dangling");
  ASSERT_TRUE(write_file(folder_ / "second", "new").ok());
  ASSERT_TRUE(write_file(folder_ / "dangling", "made").ok());
  for (const char* link : {"link", "second", "dangling"}) EXPECT_TRUE(fs::is_symlink(folder_ / link)) << link;
  EXPECT_EQ(*read_file(folder_ / "target"), "new");
  EXPECT_EQ(*read_file(folder_ / "not-yet"), "made");

  // a cycle of links is an error and no endless loop
  fs::create_symlink("ring-b", folder_ / "ring-a");
  fs::create_symlink("ring-a", folder_ / "ring-b");
  EXPECT_EQ(write_file(folder_ / "ring-a", "x").error().kind, ErrorKind::kOutput);
}

TEST_F(FileTest, LongestPermittedNameIsWritten) {
  for (const std::string ending : {"", ".h5", ".nii.gz", ".seg.nrrd"}) {
    const std::string name = std::string(255 - ending.size(), 'n') + ending;
    EXPECT_TRUE(write_file(folder_ / name, "x").ok()) << ending;
  }
  EXPECT_TRUE(write_file(folder_ / ("a." + std::string(253, 'e')), "x").ok());
  // one more is rejected before work begins
  const auto checked = claim_output(folder_ / std::string(256, 'n'));
  ASSERT_FALSE(checked.ok());
  EXPECT_NE(checked.error().what.find("too long"), std::string::npos);
}

TEST_F(FileTest, TemporaryKeepsTheFormatExtension) {
  for (const auto& [name, ending] : {std::pair<const char*, std::string>{"a.b.nii.gz", ".nii.gz"},
                                     {"a.seg.nrrd", ".seg.nrrd"},
                                     {"2024.a long remark.h5", ".h5"},
                                     {".hidden", ""}}) {
    auto pending = PendingFile::create(folder_ / name);
    ASSERT_TRUE(pending.ok()) << name;
    const std::string temporary = pending->path().filename().string();
    EXPECT_EQ(temporary.substr(std::string(".palpate-0123456789abcdef-XXXXXX").size()), ending) << name;
  }
}

TEST_F(FileTest, OutputOverAnInputIsRejected) {
  const fs::path input = folder_ / "in.nrrd";
  ASSERT_TRUE(write_file(input, "scan").ok());
  fs::create_symlink("in.nrrd", folder_ / "link.nrrd");
  fs::create_directory(folder_ / "sub");
  const std::array<fs::path, 2> never{folder_ / "other", input};
  for (const char* name : {"in.nrrd", "link.nrrd", "./in.nrrd", "sub/../in.nrrd"}) {
    const auto checked = claim_output(folder_ / name, never);
    ASSERT_FALSE(checked.ok()) << name;
    EXPECT_EQ(checked.error().kind, ErrorKind::kUsage);
    EXPECT_NE(checked.error().what.find("would replace an input"), std::string::npos);
  }
  EXPECT_TRUE(claim_output(folder_ / "out.nrrd", never).ok());
  EXPECT_TRUE(claim_output(input).ok());
}

TEST_F(FileTest, SameFileResolvesLinksOfMissingFiles) {
  fs::create_directory(folder_ / "sub");
  fs::create_symlink("sub", folder_ / "way");
  fs::create_symlink("sub/new", folder_ / "link");
  EXPECT_TRUE(same_file(folder_ / "sub/new", folder_ / "way/new"));
  EXPECT_TRUE(same_file(folder_ / "sub/new", folder_ / "link"));
  EXPECT_TRUE(same_file("new", fs::current_path() / "new"));
  EXPECT_FALSE(same_file(folder_ / "sub/new", folder_ / "new"));
}

TEST_F(FileTest, ClaimingAnOutputCreatesNoFile) {
  EXPECT_TRUE(claim_output(folder_ / "a.html").ok());
  EXPECT_EQ(folder_.count(), 0u);
  EXPECT_EQ(claim_output(folder_ / "missing/a.html").error().kind, ErrorKind::kOutput);
  EXPECT_EQ(claim_output(folder_.path()).error().kind, ErrorKind::kOutput);
}

TEST_F(FileTest, ConcurrentWritersAreRejected) {
  fs::create_symlink("a.h5", folder_ / "link.h5");
  fs::create_directory(folder_ / "sub");
  auto claim = claim_output(folder_ / "a.h5");
  ASSERT_TRUE(claim.ok());
  // the process itself continues, and the claim remains after the file is written
  ASSERT_TRUE(write_file(folder_ / "a.h5", "mine").ok());
  testing::Child other([&] {
    for (const char* name : {"a.h5", "link.h5", "sub/../a.h5"})
      for (const auto& refused :
           {claim_output(folder_ / name).error(), write_file(folder_ / name, "theirs").error()})
        if (refused.kind != ErrorKind::kOutput ||
            refused.what != "is being written by another run (process " + std::to_string(::getppid()) + ")")
          ::_exit(1);
    if (!write_file(folder_ / "b.h5", "theirs").ok()) ::_exit(1);
  });
  EXPECT_TRUE(other.finished());
  EXPECT_EQ(*read_file(folder_ / "a.h5"), "mine");

  claim = claim_output(folder_ / "c.h5");
  testing::Child later([&] {
    if (!write_file(folder_ / "a.h5", "theirs").ok()) ::_exit(1);
  });
  EXPECT_TRUE(later.finished());
  EXPECT_EQ(*read_file(folder_ / "a.h5"), "theirs");
}

TEST_F(FileTest, TemporariesOfAKilledRunAreRemovedByTheNext) {
  for (const char* next : {"a.nrrd", "c.nrrd"}) {
    testing::Shared<std::atomic<bool>> begun;
    testing::Child killed([&] {
      const auto claim = claim_output(folder_ / "a.nrrd");
      const auto pending = PendingFile::create(folder_ / "a.nrrd");
      const auto another = PendingFile::create(folder_ / "b.nrrd");
      *begun = claim.ok() && pending.ok() && another.ok();
      while (true) ::pause();
    });
    while (!*begun) ::usleep(1000);
    EXPECT_EQ(folder_.count(), 4u) << "two temporaries and two locks";
    killed.kill();
    ASSERT_TRUE(write_file(folder_ / next, "x").ok());
    EXPECT_EQ(folder_.count(), 1u) << next;
    fs::remove(folder_ / next);
  }
}

TEST_F(FileTest, TemporariesOfARunningProcessAreKept) {
  testing::Shared<std::atomic<bool>> begun, done;
  testing::Child beside([&] {
    {
      auto pending = PendingFile::create(folder_ / "beside.h5");
      *begun = pending.ok();
      while (!*done) ::usleep(1000);
      if (!pending->commit(Flush::kNone)) ::_exit(1);
    }
    if (!write_file(folder_ / "after", "theirs").ok()) ::_exit(1);
  });
  while (!*begun) ::usleep(1000);
  auto own = PendingFile::create(folder_ / "own.h5");
  ASSERT_TRUE(own.ok());
  ASSERT_TRUE(write_file(folder_ / "x", "x").ok());
  EXPECT_EQ(folder_.count(), 5u) << "two temporaries, two locks and x";
  // and this process still holds the lock on its own file
  testing::Child refused([&] {
    if (write_file(folder_ / "own.h5", "theirs").ok()) ::_exit(1);
  });
  EXPECT_TRUE(refused.finished());
  *done = true;
  EXPECT_TRUE(beside.finished());
  EXPECT_TRUE(own->commit(Flush::kNone).ok());
  EXPECT_TRUE(fs::exists(folder_ / "beside.h5"));
}

// each run sweeps the folder into which the others write
TEST_F(FileTest, ConcurrentRunsKeepEachOthersTemporaries) {
  constexpr int kRuns = 3, kFiles = 60;
  std::vector<std::unique_ptr<testing::Child>> runs;
  for (int run = 0; run < kRuns; ++run)
    runs.push_back(std::make_unique<testing::Child>([this, run] {
      for (int n = 0; n < kFiles; ++n)
        if (!write_file(folder_ / (std::to_string(run) + "-" + std::to_string(n % 4)), "x").ok()) ::_exit(1);
    }));
  for (const auto& run : runs) EXPECT_TRUE(run->finished());
  EXPECT_EQ(folder_.count(), static_cast<std::size_t>(kRuns * 4));
}

TEST_F(FileTest, ForeignFilesAreNotRemoved) {
  const std::string prefix = ".palpate-0123456789abcdef";
  ASSERT_TRUE(write_file(folder_ / "elsewhere", "kept").ok());
  for (const std::string name :
       {".palpate-notes", ".palpate-0123456789abcdeg-abcdef", ".palpate-0123456789abcdef", "palpate-x"})
    test::write_text(folder_ / name, "another program's");
  // lock file of a dead process, and links under the names of a temporary and of a lock file
  test::write_text(folder_ / (prefix + ".lock"), "");
  test::write_text(folder_ / (prefix + "-abcdef.h5"), "left behind");
  fs::create_symlink("elsewhere", folder_ / (prefix + "-linked"));
  fs::create_symlink("elsewhere", folder_ / ".palpate-fedcba9876543210.lock");
  test::write_text(folder_ / ".palpate-fedcba9876543210-abcdef", "whose lock is a link");
  ASSERT_TRUE(write_file(folder_ / "x", "x").ok());
  EXPECT_FALSE(fs::exists(folder_ / (prefix + "-abcdef.h5")));
  EXPECT_FALSE(fs::exists(folder_ / (prefix + ".lock")));
  EXPECT_EQ(*read_file(folder_ / "elsewhere"), "kept");
  EXPECT_TRUE(fs::is_symlink(folder_ / (prefix + "-linked")));
  EXPECT_EQ(folder_.count(), 9u);
}

TEST_F(FileTest, FolderIsRejectedAsInputAndOutput) {
  EXPECT_EQ(read_file(folder_.path()).error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(write_file(folder_.path(), "x").error().kind, ErrorKind::kOutput);
}

TEST_F(FileTest, NonRegularFilesAreRejected) {
  const auto refused_as = [](const fs::path& file, const char* kind) {
    const auto read = read_file(file);
    ASSERT_FALSE(read.ok()) << file;
    EXPECT_EQ(read.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(read.error().what, std::string("is ") + kind + ", not a file");
    EXPECT_FALSE(InputFile::open(file).ok());
  };
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  fs::create_symlink("pipe", folder_ / "link");
  refused_as(folder_ / "pipe", "a pipe");
  refused_as(folder_ / "link", "a pipe");
  // with a writer there would be bytes, and no end of file
  const int writer = ::open((folder_ / "pipe").c_str(), O_RDWR | O_CLOEXEC);
  EXPECT_EQ(::write(writer, "x", 1), 1);
  refused_as(folder_ / "pipe", "a pipe");
  ::close(writer);

  refused_as("/dev/zero", "a device");
  sockaddr_un address{AF_UNIX, "socket"};
  const int socket = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const fs::path here = fs::current_path();
  fs::current_path(folder_.path());
  EXPECT_EQ(::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  fs::current_path(here);
  refused_as(folder_ / "socket", "a socket");
  ::close(socket);
}

TEST_F(FileTest, OpenFileKeepsItsContentAfterReplacement) {
  ASSERT_TRUE(write_file(folder_ / "a", "0123456789").ok());
  auto opened = InputFile::open(folder_ / "a");
  ASSERT_TRUE(opened.ok());
  // another file takes its name
  ASSERT_TRUE(write_file(folder_ / "a", "other").ok());
  EXPECT_EQ(opened->size(), 10u);
  std::array<char, 4> bytes{};
  EXPECT_EQ(*opened->read_at(8, std::as_writable_bytes(std::span(bytes))), 2u);
  EXPECT_EQ(*opened->read(std::as_writable_bytes(std::span(bytes))), 4u);
  EXPECT_EQ(std::string(bytes.data(), 4), "0123");
  EXPECT_EQ(test::bytes_of_file(opened->name_for_libraries()), "0123456789");
}

TEST_F(FileTest, TooLargeAndMissingAreErrors) {
  ASSERT_TRUE(write_file(folder_ / "a", "0123456789").ok());
  EXPECT_TRUE(read_file(folder_ / "a", 10).ok());
  EXPECT_FALSE(read_file(folder_ / "a", 9).ok());
  EXPECT_EQ(read_file(folder_ / "b").error().what, "no such file");
}

}  // namespace
}  // namespace palpate
