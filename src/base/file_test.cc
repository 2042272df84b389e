#include "base/file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cerrno>
#include <csignal>
#include <fstream>

#include "base/test_files.h"
#include "palpate/output.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

class FileTest : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
};

TEST_F(FileTest, WritesAndReadsBackWhatWasWritten) {
  const std::string bytes("a\0b\n", 4);
  ASSERT_TRUE(write_file(folder_ / "a.bin", bytes).ok());
  EXPECT_EQ(*read_file(folder_ / "a.bin"), bytes);
  EXPECT_EQ(folder_.count(), 1u);
}

TEST_F(FileTest, OverwritesWhole) {
  ASSERT_TRUE(write_file(folder_ / "a", "longer content").ok());
  ASSERT_TRUE(write_file(folder_ / "a", "short").ok());
  EXPECT_EQ(*read_file(folder_ / "a"), "short");
}

TEST_F(FileTest, UncommittedFileLeavesNothing) {
  {
    auto pending = PendingFile::create(folder_ / "x.nii.gz");
    ASSERT_TRUE(pending.ok());
    EXPECT_TRUE(pending->path().string().ends_with(".nii.gz"));
    std::ofstream(pending->path()) << "half";
  }
  EXPECT_EQ(folder_.count(), 0u);
}

TEST_F(FileTest, AFullDiskIsAnOutputErrorThatKeepsTheOldFile) {
  // the limit on file sizes stands in for a full disk
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

TEST_F(FileTest, ADeviceIsNotReplaced) {
  const auto result = write_file("/dev/null", "x");
  ASSERT_FALSE(result.ok());
  EXPECT_NE(result.error().what.find("ordinary"), std::string::npos);
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(FileTest, MissingFolderNamesTheFolder) {
  const auto result = write_file(folder_ / "missing/a", "x");
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().kind, ErrorKind::kOutput);
  EXPECT_NE(result.error().what.find("does not exist"), std::string::npos);
}

TEST_F(FileTest, CheckingAnOutputLeavesNothing) {
  EXPECT_TRUE(check_output(folder_ / "a.html").ok());
  EXPECT_EQ(folder_.count(), 0u);
  EXPECT_EQ(check_output(folder_ / "missing/a.html").error().kind, ErrorKind::kOutput);
  EXPECT_EQ(check_output(folder_.path()).error().kind, ErrorKind::kOutput);
}

TEST_F(FileTest, AFolderIsNeitherReadNorWritten) {
  EXPECT_EQ(read_file(folder_.path()).error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(write_file(folder_.path(), "x").error().kind, ErrorKind::kOutput);
}

TEST_F(FileTest, TooLargeAndMissingAreErrors) {
  ASSERT_TRUE(write_file(folder_ / "a", "0123456789").ok());
  EXPECT_TRUE(read_file(folder_ / "a", 10).ok());
  EXPECT_FALSE(read_file(folder_ / "a", 9).ok());
  EXPECT_EQ(read_file(folder_ / "b").error().what, "no such file");
}

}  // namespace
}  // namespace palpate
