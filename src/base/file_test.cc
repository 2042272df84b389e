#include "base/file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <utility>

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

TEST_F(FileTest, WhatStandsInTheWayIsNamed) {
  ASSERT_TRUE(write_file(folder_ / "a", "a").ok());
  for (const char* below : {"a/b", "a/b/c"})
    EXPECT_NE(write_file(folder_ / below, "x").error().what.find("a is a file and not a folder"),
              std::string::npos);
  EXPECT_NE(output_error(folder_ / "a", ENOTDIR).what.find("a is a file"), std::string::npos);
  // a folder that is there and still takes nothing is not called missing
  EXPECT_NE(write_file("/proc/x.h5", "x").error().what.find("takes no files"), std::string::npos);
}

TEST_F(FileTest, ALinkStaysAndItsTargetIsWritten) {
  ASSERT_TRUE(write_file(folder_ / "target", "old").ok());
  fs::create_symlink("target", folder_ / "link");
  fs::create_symlink(folder_ / "link", folder_ / "second");
  fs::create_symlink("not-yet", folder_ / "dangling");
  ASSERT_TRUE(write_file(folder_ / "second", "new").ok());
  ASSERT_TRUE(write_file(folder_ / "dangling", "made").ok());
  for (const char* link : {"link", "second", "dangling"}) EXPECT_TRUE(fs::is_symlink(folder_ / link)) << link;
  EXPECT_EQ(*read_file(folder_ / "target"), "new");
  EXPECT_EQ(*read_file(folder_ / "not-yet"), "made");

  // a ring of links is an error and no endless walk
  fs::create_symlink("ring-b", folder_ / "ring-a");
  fs::create_symlink("ring-a", folder_ / "ring-b");
  EXPECT_EQ(write_file(folder_ / "ring-a", "x").error().kind, ErrorKind::kOutput);
}

TEST_F(FileTest, NamesAsLongAsTheSystemTakesAreWritten) {
  for (const std::string ending : {"", ".h5", ".nii.gz", ".seg.nrrd"}) {
    const std::string name = std::string(255 - ending.size(), 'n') + ending;
    EXPECT_TRUE(write_file(folder_ / name, "x").ok()) << ending;
  }
  EXPECT_TRUE(write_file(folder_ / ("a." + std::string(253, 'e')), "x").ok());
  // one more is refused before work begins
  const auto checked = check_output(folder_ / std::string(256, 'n'));
  ASSERT_FALSE(checked.ok());
  EXPECT_NE(checked.error().what.find("too long"), std::string::npos);
}

TEST_F(FileTest, TemporariesKeepTheEndingThatNamesTheFormat) {
  for (const auto& [name, ending] : {std::pair<const char*, std::string>{"a.b.nii.gz", ".nii.gz"},
                                     {"a.seg.nrrd", ".seg.nrrd"},
                                     {"2024.a long remark.h5", ".h5"},
                                     {".hidden", ""}}) {
    auto pending = PendingFile::create(folder_ / name);
    ASSERT_TRUE(pending.ok()) << name;
    const std::string temporary = pending->path().filename().string();
    EXPECT_EQ(temporary.substr(std::string(".palpate-XXXXXX").size()), ending) << name;
  }
}

TEST_F(FileTest, AnOutputDoesNotReplaceAnInput) {
  const fs::path input = folder_ / "in.nrrd";
  ASSERT_TRUE(write_file(input, "scan").ok());
  fs::create_symlink("in.nrrd", folder_ / "link.nrrd");
  fs::create_directory(folder_ / "sub");
  const std::array<fs::path, 2> never{folder_ / "other", input};
  for (const char* name : {"in.nrrd", "link.nrrd", "./in.nrrd", "sub/../in.nrrd"}) {
    const auto checked = check_output(folder_ / name, never);
    ASSERT_FALSE(checked.ok()) << name;
    EXPECT_EQ(checked.error().kind, ErrorKind::kUsage);
    EXPECT_NE(checked.error().what.find("would replace an input"), std::string::npos);
  }
  EXPECT_TRUE(check_output(folder_ / "out.nrrd", never).ok());
  EXPECT_TRUE(check_output(input).ok());
}

TEST_F(FileTest, OneFileHasManyNamesAlsoBeforeItIsThere) {
  fs::create_directory(folder_ / "sub");
  fs::create_symlink("sub", folder_ / "way");
  fs::create_symlink("sub/new", folder_ / "link");
  EXPECT_TRUE(same_file(folder_ / "sub/new", folder_ / "way/new"));
  EXPECT_TRUE(same_file(folder_ / "sub/new", folder_ / "link"));
  EXPECT_TRUE(same_file("new", fs::current_path() / "new"));
  EXPECT_FALSE(same_file(folder_ / "sub/new", folder_ / "new"));
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
