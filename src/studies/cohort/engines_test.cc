#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "base/test_folder.h"
#include "palpate/base/file.h"
#include "palpate/cohort/engines.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

TEST(Processes, SayHowTheyEnded) {
  const auto failed = run_process({"sh", "-c", "echo nothing; echo why >&2; exit 3"});
  ASSERT_TRUE(failed);
  EXPECT_EQ(failed->exit_code, 3);
  EXPECT_EQ(failed->signal, 0);
  EXPECT_EQ(failed->error_output, "why\n");
  const auto killed = run_process({"sh", "-c", "kill -9 $$"});
  ASSERT_TRUE(killed);
  EXPECT_EQ(killed->exit_code, -1);
  EXPECT_EQ(killed->signal, 9);
  const auto missing = run_process({"/no/such/program"});
  ASSERT_TRUE(missing);
  EXPECT_EQ(missing->exit_code, 127);
}

TEST(RunLocally, EachNumberOnceAndSomeAtATime) {
  const test::TemporaryFolder folder;
  const std::string script =
      "touch '" + (folder / "begun-").string() +
      "'$0; sleep 0.05; [ $0 != 3 ] || kill -9 $$; [ $0 != 4 ] || { echo why >&2; exit 4; }";
  std::vector<int> ended;
  ASSERT_TRUE(
      run_locally({"sh", "-c", script}, {1, 2, 3, 4, 5, 9}, 2, [&](int number, const EndedProcess& how) {
        ended.push_back(number);
        EXPECT_EQ(how.signal, number == 3 ? 9 : 0) << number;
        EXPECT_EQ(how.exit_code, number == 3 ? -1 : number == 4 ? 4 : 0) << number;
        EXPECT_EQ(how.error_output, number == 4 ? "why\n" : "") << number;
      }));
  std::ranges::sort(ended);
  // a killed and a failed process do not affect the others
  EXPECT_EQ(ended, (std::vector<int>{1, 2, 3, 4, 5, 9}));
  for (const int number : ended) EXPECT_TRUE(fs::exists(folder / ("begun-" + std::to_string(number))));
}

TEST(RunLocally, InterruptEndsRunningJobs) {
  const test::TemporaryFolder folder;
  std::atomic<bool> stop = false;
  std::thread later([&] {
    while (!fs::exists(folder / "pid-1") || !fs::exists(folder / "pid-2"))
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    stop = true;
  });
  // each ends only after both have received the signal: none is waited for before
  const std::string script =
      "cd '" + folder.path().string() +
      "'; trap 'touch asked-$0; until [ -e asked-1 ] && [ -e asked-2 ]; do sleep 0.02; "
      "done; touch both-$0; exit' TERM; echo $$ > made-$0; mv made-$0 pid-$0; "
      "while :; do sleep 0.02; done";
  const auto ran = run_locally(
      {"sh", "-c", script}, {1, 2, 3}, 2, [](int, const EndedProcess&) {}, Progress({}, &stop));
  later.join();
  ASSERT_FALSE(ran);
  EXPECT_EQ(ran.error().kind, ErrorKind::kInterrupted);
  EXPECT_FALSE(fs::exists(folder / "pid-3"));
  EXPECT_TRUE(fs::exists(folder / "both-1") && fs::exists(folder / "both-2"));
  for (const char* name : {"pid-1", "pid-2"}) {
    const auto pid = read_file(folder / name);
    ASSERT_TRUE(pid);
    const std::string number = pid->substr(0, pid->find('\n'));
    ASSERT_FALSE(number.empty());
    EXPECT_FALSE(fs::exists("/proc/" + number + "/exe")) << "it has ended";
  }
}

/// Fake Slurm commands, implemented by shell scripts, which take precedence while the object exists.
class PlayedSlurm {
 public:
  explicit PlayedSlurm(const fs::path& folder) : folder_(folder), path_(::getenv("PATH")) {
    ::setenv("PATH", (folder.string() + ":" + path_).c_str(), 1);
    play("sbatch", "cat > /dev/null; touch alive; echo 12");
    play("squeue", "[ ! -e alive ] || echo RUNNING");
    play("scancel", "rm alive");
  }
  ~PlayedSlurm() { ::setenv("PATH", path_.c_str(), 1); }
  void play(const std::string& name, const std::string& script) {
    ASSERT_TRUE(write_file(folder_ / name, "#!/bin/sh\ncd '" + folder_.string() + "'\n" + script + "\n"));
    fs::permissions(folder_ / name, fs::perms::owner_all);
  }

 private:
  fs::path folder_;
  std::string path_;
};

TEST(RunBySlurm, NoteIsKeptUntilTheJobEnds) {
  const test::TemporaryFolder folder;
  PlayedSlurm slurm(folder.path());
  SlurmOptions options;
  options.folder = folder.path();
  options.late_s = 0;
  std::atomic<bool> stop = false;
  const auto run = [&] {
    stop = false;
    return run_by_slurm(
        {"true"}, [] { return std::vector<int>{1}; }, options,
        [&] {
          stop = true;
          return std::size_t{1};
        },
        Progress({}, &stop));
  };
  // a job that cannot be cancelled continues, and blocks the folder
  slurm.play("scancel", "exit 1");
  const auto lives = run();
  ASSERT_FALSE(lives);
  EXPECT_EQ(lives.error().kind, ErrorKind::kInterrupted);
  EXPECT_TRUE(fs::exists(folder / "slurm-job"));
  const auto refused = check_no_slurm_job(folder.path());
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().what.find("12 is still running"), std::string::npos) << refused.error().what;
  slurm.play("squeue", "echo 'Unable to contact' >&2; exit 1");
  EXPECT_FALSE(check_no_slurm_job(folder.path())) << "nobody knows";
  EXPECT_TRUE(fs::exists(folder / "slurm-job"));
  // a job that was cancelled and is gone
  slurm.play("squeue", "[ ! -e alive ] || echo RUNNING");
  slurm.play("scancel", "rm alive");
  EXPECT_FALSE(run());
  EXPECT_FALSE(fs::exists(folder / "slurm-job"));
  EXPECT_TRUE(check_no_slurm_job(folder.path()).ok());
}

TEST(RunBySlurm, AMissingCommandIsReportedWithoutRetries) {
  const test::TemporaryFolder folder;
  PlayedSlurm slurm(folder.path());
  slurm.play("squeue", "exit 127");
  SlurmOptions options;
  options.folder = folder.path();
  int looks = 0;
  const auto ran = run_by_slurm(
      {"true"}, [] { return std::vector<int>{1}; }, options,
      [&] {
        ++looks;
        return std::size_t{1};
      });
  ASSERT_FALSE(ran);
  EXPECT_EQ(ran.error().where, "squeue");
  EXPECT_EQ(looks, 0) << "a retry would look for results first";
}

TEST(RunBySlurm, RetriesUntilRemoteFilesAppear) {
  const test::TemporaryFolder folder;
  PlayedSlurm slurm(folder.path());
  slurm.play("sbatch", "cat > /dev/null; echo 12");
  SlurmOptions options;
  options.folder = folder.path();
  int appearances = 0;
  const auto ran = run_by_slurm(
      {"true"}, [] { return std::vector<int>{1}; }, options, [&] { return std::size_t{++appearances < 3}; });
  EXPECT_TRUE(ran);
  EXPECT_EQ(appearances, 3);
  EXPECT_FALSE(fs::exists(folder / "slurm-job"));
}

}  // namespace
}  // namespace palpate
