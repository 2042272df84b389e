#include "palpate/base/reading.h"

#include <gtest/gtest.h>

#include "base/test_folder.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// restores the process's limits
class ReadingTest : public ::testing::Test {
 protected:
  ~ReadingTest() override { set_reading_limits({}); }
  test::TemporaryFolder folder_;
};

constexpr std::uint64_t kGiB = std::uint64_t{1} << 30;

TEST_F(ReadingTest, ParsesFormattedAmounts) {
  EXPECT_EQ(parse_memory_size("800M"), 800u << 20);
  EXPECT_EQ(parse_memory_size("1.5GiB"), 3 * kGiB / 2);
  EXPECT_EQ(parse_memory_size("4 gb"), 0u) << "bits or bytes?";
  EXPECT_EQ(parse_memory_size("4 GB"), 4 * kGiB);
  EXPECT_EQ(parse_memory_size("2t"), 2048 * kGiB);
  for (const char* wrong : {"", "4", "G", "-4G", "4X", "4Gx", "0G", "nanG", "infG", "1e30G", "99999999999T"})
    EXPECT_EQ(parse_memory_size(wrong), 0u) << wrong;
  EXPECT_EQ(memory_size_text(5 * kGiB + kGiB / 10), "5.1 GiB");
  EXPECT_EQ(parse_memory_size(memory_size_text(kGiB)), kGiB);
}

TEST_F(ReadingTest, MemoryLimitIncludesMemoryInUse) {
  set_reading_limits({.max_memory_bytes = 4 * kGiB});
  EXPECT_TRUE(check_memory(kGiB, "a").ok());
  EXPECT_FALSE(check_memory(4 * kGiB, "a").ok()) << "the process has some itself";
  const Error error = check_memory(8 * kGiB, "scan.nrrd").error();
  EXPECT_EQ(error.where, "scan.nrrd");
  EXPECT_NE(error.what.find("of memory, 4.0 GiB are allowed"), std::string::npos) << error.what;
  // the remedy that it names works
  const auto at = error.remedy.find("--memory ") + 9;
  set_reading_limits(
      {.max_memory_bytes = parse_memory_size(error.remedy.substr(at, error.remedy.find(',', at) - at))});
  EXPECT_TRUE(check_memory(8 * kGiB, "scan.nrrd").ok());
  EXPECT_TRUE(check_memory(8 * kGiB + (8 << 20), "scan.nrrd").ok())
      << "also where a run has taken more itself";
}

TEST_F(ReadingTest, DefaultMemoryLimitIsHalfOfTheMachine) {
  EXPECT_TRUE(check_memory(1 << 20, "a").ok());
  EXPECT_FALSE(check_memory(std::uint64_t{1} << 62, "a").ok());
}

TEST_F(ReadingTest, PathOutsideTheFolderIsRejected) {
  const fs::path home = folder_ / "home";
  test::write_text(home / "below/data", "x");
  test::write_text(folder_ / "home2/data", "x");
  fs::create_symlink("below/data", home / "inside");
  fs::create_symlink("../home2/data", home / "outside");
  fs::create_symlink("../home2", home / "way");
  fs::create_symlink("home", folder_ / "other-name");
  for (const char* name : {"below/data", "inside", "missing", "../home/inside"})
    EXPECT_TRUE(check_stays_in(home, home / name).ok()) << name;
  EXPECT_TRUE(check_stays_in(folder_ / "other-name", folder_ / "other-name/inside").ok());
  for (const char* name : {"outside", "way/data", "../home2/data"}) {
    const auto stays = check_stays_in(home, home / name);
    ASSERT_FALSE(stays.ok()) << name;
    EXPECT_NE(stays.error().remedy.find("--follow-links"), std::string::npos);
  }
  set_reading_limits({.follow_links = true});
  EXPECT_TRUE(check_stays_in(home, home / "outside").ok());
}

}  // namespace
}  // namespace palpate
