#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "base/test_folder.h"
#include "palpate/base/file.h"
#include "palpate/cohort/cohort.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

TEST(Processes, SayHowTheyEnded) {
  const auto failed = run_process({"sh", "-c", "echo nothing; echo why >&2; exit 3"});
  ASSERT_TRUE(failed);
  EXPECT_EQ(failed->exit_code, 3);
  EXPECT_EQ(failed->signal, 0);
  EXPECT_EQ(failed->said, "why\n");
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
      "touch '" + (folder / "begun-").string() + "'$0; sleep 0.05; [ $0 != 3 ] || kill -9 $$; [ $0 != 4 ]";
  std::vector<int> ended;
  ASSERT_TRUE(
      run_locally({"sh", "-c", script}, {1, 2, 3, 4, 5, 9}, 2, [&](int number) { ended.push_back(number); }));
  std::ranges::sort(ended);
  // one that is killed and one that fails stop nobody
  EXPECT_EQ(ended, (std::vector<int>{1, 2, 3, 4, 5, 9}));
  for (const int number : ended) EXPECT_TRUE(fs::exists(folder / ("begun-" + std::to_string(number))));
}

TEST(RunLocally, EndsWhatRunsWhenItIsInterrupted) {
  const test::TemporaryFolder folder;
  std::atomic<bool> stop = false;
  std::thread later([&] {
    while (!fs::exists(folder / "pid-1")) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    stop = true;
  });
  const std::string script = "echo $$ > '" + (folder / "pid-").string() + "'$0; exec sleep 60";
  const auto ran = run_locally(
      {"sh", "-c", script}, {1, 2, 3}, 1, [](int) {}, Progress({}, &stop));
  later.join();
  ASSERT_FALSE(ran);
  EXPECT_EQ(ran.error().kind, ErrorKind::kInterrupted);
  EXPECT_FALSE(fs::exists(folder / "pid-2"));
  auto pid = read_file(folder / "pid-1");
  ASSERT_TRUE(pid);
  pid->pop_back();
  EXPECT_FALSE(fs::exists("/proc/" + *pid + "/exe")) << "it has ended";
}

}  // namespace
}  // namespace palpate
