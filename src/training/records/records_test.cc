#include "palpate/records/records.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <random>
#include <thread>

#include "base/test_child.h"
#include "base/test_folder.h"
#include "base/test_seed.h"
#include "palpate/base/file.h"
#include "palpate/base/learner.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

RunRecord a_run(const std::string& learner, int number) {
  RunRecord run;
  run.learner = learner;
  run.task = number % 2 ? "Hold a force steady" : "Probing the menisci";
  run.task_hash = "00ff";
  run.started_utc = "2026-01-02T03:04:05Z";
  run.data_set = "knee-phantom:seed=3";
  run.palpate_version = "0.1.0";
  run.commit = "abc";
  run.device = "premium-1.5";
  run.settings_hash = "aa";
  run.run_hash = "bb";
  run.score_hash = std::to_string(number);
  run.duration_s = 12.5;
  run.in_a_row = 3;
  run.in_band = number % 3 == 0;
  run.metrics = {{"time", "s", 12.5, {}, 95, true, true}, {"peak_force", "N", {}, {}, {}, false, false}};
  return run;
}

std::vector<RunRecord> listed(Records& records, const RunFilter& filter = {}) {
  std::vector<RunRecord> runs;
  const auto done = records.list(filter, [&](const RunRecord& run) -> Result<void> {
    runs.push_back(run);
    return {};
  });
  EXPECT_TRUE(done.ok());
  return runs;
}

std::string all_bytes_beside(const fs::path& folder) {
  std::string bytes;
  for (const auto& entry : fs::directory_iterator(folder)) bytes += *read_file(entry.path());
  return bytes;
}

TEST(Records, ReturnAddedRuns) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "records.db";
  const RunRecord run = a_run("L1", 3);
  {
    auto records = Records::open(file);
    ASSERT_TRUE(records.ok()) << records.error().message();
    const auto id = (*records)->add(run);
    ASSERT_TRUE(id.ok()) << id.error().message();
    EXPECT_EQ(*id, 1);
    // adding the same run again has no effect; another learner or start time makes it a different run
    EXPECT_EQ(*(*records)->add(run), 1);
    EXPECT_EQ(*(*records)->add(a_run("L2", 3)), 2);
  }
  auto records = Records::open_to_read(file);
  ASSERT_TRUE(records.ok()) << records.error().message();
  const auto back = (*records)->run(1);
  ASSERT_TRUE(back.ok());
  EXPECT_EQ(back->learner, "L1");
  EXPECT_EQ(back->metrics, run.metrics);
  EXPECT_EQ(back->score_hash, "3");
  EXPECT_EQ(back->in_band, true);
  EXPECT_EQ(back->duration_s, 12.5);
  EXPECT_THAT((*records)->run(9).error().message(), HasSubstr("no run 9"));
}

TEST(Records, FilesAreReadableByTheirOwnerOnly) {
  const test::TemporaryFolder folder;
  const mode_t before = ::umask(0);
  auto records = Records::open(folder / "records.db");
  ASSERT_TRUE(records.ok());
  ASSERT_TRUE((*records)->add(a_run("L042", 1)).ok());
  ::umask(before);
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    struct stat status;
    ASSERT_EQ(::stat(entry.path().c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0600u) << entry.path();
  }
}

TEST(Records, ListMatchesTheQuery) {
  const test::TemporaryFolder folder;
  auto records = Records::open(folder / "records.db");
  ASSERT_TRUE(records.ok());
  for (int n = 0; n < 40; ++n) ASSERT_TRUE((*records)->add(a_run("L" + std::to_string(n % 4), n)).ok());
  EXPECT_EQ(listed(**records).size(), 40u);
  EXPECT_EQ(listed(**records, {"L2", "", 0}).size(), 10u);
  EXPECT_EQ(listed(**records, {"", "Hold a force steady", 0}).size(), 20u);
  EXPECT_EQ(listed(**records, {"L2", "Hold a force steady", 0}).size(), 0u);
  const auto newest = listed(**records, {"", "", 3});
  ASSERT_EQ(newest.size(), 3u);
  EXPECT_EQ(newest[0].id, 38);
  EXPECT_EQ(newest[2].id, 40);
  // quotation marks are ordinary characters
  EXPECT_EQ(listed(**records, {"'; DROP TABLE runs; --", "", 0}).size(), 0u);
  EXPECT_EQ(listed(**records).size(), 40u);
}

TEST(Records, EraseLeavesNoByte) {
  const std::string canary = "DOE^CANARY";
  const test::TemporaryFolder folder;
  const fs::path file = folder / "records.db";
  std::mt19937_64 random(test::test_seed());
  auto records = Records::open(file);
  ASSERT_TRUE(records.ok());
  for (int n = 0; n < 300; ++n) {
    RunRecord run = a_run(random() % 3 == 0 ? canary : "L" + std::to_string(random() % 5), n);
    // text that belongs to this learner only
    if (run.learner == canary) run.metrics[0].name = canary + " alone";
    ASSERT_TRUE((*records)->add(run).ok());
  }
  ASSERT_NE(all_bytes_beside(folder.path()).find(canary), std::string::npos);
  const std::size_t others = listed(**records).size() - listed(**records, {canary, "", 0}).size();
  const auto erased = (*records)->erase(canary);
  ASSERT_TRUE(erased.ok()) << erased.error().message();
  EXPECT_TRUE(erased->was_known);
  EXPECT_GT(erased->runs, 50);
  EXPECT_EQ(all_bytes_beside(folder.path()).find(canary), std::string::npos);
  EXPECT_EQ(all_bytes_beside(folder.path()).find("CANARY"), std::string::npos);
  EXPECT_EQ(listed(**records).size(), others);
  EXPECT_FALSE((*records)->erase(canary)->was_known);
  // the rebuilt file is still a valid records file
  EXPECT_TRUE(Records::open(file).ok());
  records->reset();
  EXPECT_EQ(all_bytes_beside(folder.path()).find("CANARY"), std::string::npos);
}

TEST(Records, EraseReportsALockedLog) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "records.db";
  auto records = Records::open(file);
  ASSERT_TRUE(records.ok());
  for (int n = 0; n < 5; ++n) ASSERT_TRUE((*records)->add(a_run("DOE^CANARY", n)).ok());
  // a reader in the middle of a query pins the old snapshot
  sqlite3* reader = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &reader), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(reader, "BEGIN; SELECT count(*) FROM runs", nullptr, nullptr, nullptr), SQLITE_OK);
  const auto stored = (*records)->erase("DOE^CANARY");
  ASSERT_FALSE(stored.ok());
  EXPECT_THAT(stored.error().message(), HasSubstr("traces may remain"));
  EXPECT_TRUE(listed(**records).empty());
  sqlite3_close(reader);
  ASSERT_TRUE((*records)->erase("DOE^CANARY").ok());
  EXPECT_EQ(all_bytes_beside(folder.path()).find("CANARY"), std::string::npos);
}

TEST(Records, RejectsFilesThatAreNotRecords) {
  const test::TemporaryFolder folder;
  EXPECT_FALSE(Records::open_to_read(folder / "none.db").ok());
  EXPECT_FALSE(Records::open(folder / "no" / "folder.db").ok());
  EXPECT_FALSE(Records::open(folder.path()).ok());
  const auto text = folder / "text.db";
  ASSERT_TRUE(write_file(text, "learner,task\n" + std::string(5000, 'x')).ok());
  EXPECT_THAT(Records::open(text).error().message(), HasSubstr("not complete records"));
  EXPECT_THAT(*read_file(text), HasSubstr("learner,task"));
  // another program's database, and one with a view, trigger or the like
  const auto foreign = folder / "foreign.db";
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(foreign.c_str(), &database), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(database, "CREATE TABLE t(a)", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
  EXPECT_THAT(Records::open(foreign).error().message(), HasSubstr("does not hold palpate's records"));
  const auto more = folder / "more.db";
  ASSERT_TRUE(Records::open(more).ok());
  ASSERT_EQ(sqlite3_open(more.c_str(), &database), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(database, "CREATE TRIGGER t AFTER INSERT ON runs BEGIN DELETE FROM learners; END",
                         nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(database);
  EXPECT_THAT(Records::open(more).error().message(), HasSubstr("tables of these records"));
}

TEST(Records, ALearnerIsALineOfText) {
  EXPECT_TRUE(check_learner("L042").ok());
  EXPECT_TRUE(check_learner("DOE^CANARY").ok());
  EXPECT_TRUE(check_learner("Lernende-7ä").ok());
  for (const std::string& bad : {std::string(), std::string(65, 'x'), std::string("a\nb"),
                                 std::string("\x9b"
                                             "1m"),
                                 std::string("a\0b", 3)})
    EXPECT_FALSE(check_learner(bad).ok());
  EXPECT_TRUE(resembles_personal_name("DOE^CANARY"));
  EXPECT_TRUE(resembles_personal_name("Jane Doe"));
  EXPECT_TRUE(resembles_personal_name("jane@example.org"));
  EXPECT_FALSE(resembles_personal_name("L042"));
}

TEST(Records, TwoWritersWaitForEachOther) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "records.db";
  ASSERT_TRUE(Records::open(file).ok());
  std::atomic<int> failed = 0;
  std::vector<std::thread> writers;
  for (int w = 0; w < 3; ++w) {
    writers.emplace_back([&, w] {
      auto records = Records::open(file);
      for (int n = 0; n < 20; ++n)
        failed += !records.ok() || !(*records)->add(a_run("L" + std::to_string(w), n)).ok();
    });
  }
  for (std::thread& writer : writers) writer.join();
  EXPECT_EQ(failed, 0);
  EXPECT_EQ(listed(**Records::open(file)).size(), 60u);
}

/// A process that adds runs is killed at a random moment: every run for which add() had returned is complete
/// in the file. 20 times, or PALPATE_TEST_KILLS times.
TEST(KilledRecords, LoseNoRunThatWasCommitted) {
  const char* value = std::getenv("PALPATE_TEST_KILLS");
  const int kills = value ? std::atoi(value) : 20;
  std::mt19937_64 random(test::test_seed());
  const test::TemporaryFolder folder;
  const fs::path file = folder / "records.db";
  ASSERT_TRUE(Records::open(file).ok());
  const testing::Shared<std::atomic<std::int64_t>> committed;
  int next = 0;
  for (int n = 0; n < kills; ++n) {
    {
      const bool erases = n % 4 == 3;
      testing::Child child([&] {
        auto records = Records::open(file);
        if (!records) return;
        for (int i = next;; ++i) {
          const auto id = (*records)->add(a_run("L" + std::to_string(i % 5), i));
          if (!id) return;
          *committed = *id;
          if (erases && i % 20 == 19) (void)(*records)->erase("nobody");  // rebuilds the file
        }
      });
      ::usleep(static_cast<useconds_t>(random() % 30000));
    }
    auto records = Records::open(file);
    ASSERT_TRUE(records.ok()) << records.error().message();
    const auto runs = listed(**records);
    ASSERT_GE(static_cast<std::int64_t>(runs.size()), committed->load()) << "kill " << n;
    for (std::size_t i = 0; i < runs.size(); ++i) {
      ASSERT_EQ(runs[i].id, static_cast<std::int64_t>(i) + 1);
      ASSERT_EQ(runs[i].score_hash, std::to_string(i));
    }
    if (!runs.empty()) {
      ASSERT_EQ((*records)->run(runs.back().id)->metrics, a_run("", 0).metrics);
    }
    next = static_cast<int>(runs.size());
    *committed = next;
  }
  EXPECT_GT(next, kills);
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  std::string verdict;
  sqlite3_exec(
      database, "PRAGMA integrity_check",
      [](void* to, int, char** values, char**) {
        *static_cast<std::string*>(to) += values[0];
        return 0;
      },
      &verdict, nullptr);
  sqlite3_close(database);
  EXPECT_EQ(verdict, "ok");
}

// random byte changes give an error or rows, never a crash
TEST(Records, DamagedBytesAreBorne) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "records.db";
  {
    auto records = Records::open(file);
    ASSERT_TRUE(records.ok());
    for (int n = 0; n < 60; ++n) ASSERT_TRUE((*records)->add(a_run("L" + std::to_string(n % 3), n)).ok());
  }
  const std::string whole = *read_file(file);
  std::mt19937_64 random(test::test_seed());
  int refused = 0;
  for (int n = 0; n < 300; ++n) {
    std::string damaged = whole;
    for (int i = 0; i < 1 + n % 8; ++i) damaged[random() % damaged.size()] = static_cast<char>(random());
    if (n % 5 == 0) damaged.resize(random() % damaged.size());
    const fs::path other = folder / "damaged.db";
    ASSERT_TRUE(write_file(other, damaged).ok());
    for (const char* rest : {"-wal", "-shm"}) fs::remove(other.string() + rest);
    auto records = Records::open_to_read(other);
    if (!records) {
      ++refused;
      EXPECT_FALSE(records.error().remedy.empty());
      continue;
    }
    (void)(*records)->list({}, [](const RunRecord&) -> Result<void> { return {}; });
    for (std::int64_t id = 1; id <= 60; id += 7) (void)(*records)->run(id);
  }
  EXPECT_GT(refused, 30);
}

}  // namespace
}  // namespace palpate
