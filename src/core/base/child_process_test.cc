#include "palpate/base/child_process.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <utility>

#include "base/test_child.h"
#include "base/test_limits.h"

namespace palpate {
namespace {

pid_t fork_to(void (*work)()) {
  const pid_t id = ::fork();
  if (id == 0) {
    // a test that fails leaves no process behind
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    work();
    ::_exit(0);
  }
  return id;
}

void wait_for_ever() {
  for (;;) ::pause();
}

bool ended(const ChildProcess& process) {
  pollfd file{process.pidfd(), POLLIN, 0};
  return ::poll(&file, 1, 10'000) == 1;
}

TEST(ChildProcess, EndTerminatesAndReapsTheChild) {
  const pid_t id = fork_to(wait_for_ever);
  ChildProcess process(id);
  ASSERT_GE(process.pidfd(), 0);
  process.end();
  process.end();
  EXPECT_EQ(process.pidfd(), -1);
  EXPECT_TRUE(::waitpid(id, nullptr, 0) < 0 && errno == ECHILD);
}

TEST(ChildProcess, DestructorEndsTheChild) {
  const pid_t id = fork_to(wait_for_ever);
  {
    ChildProcess process(id);
    const ChildProcess moved = std::move(process);
    EXPECT_GE(moved.pidfd(), 0);
  }
  EXPECT_TRUE(::waitpid(id, nullptr, 0) < 0 && errno == ECHILD);
}

// the process id may be reused by then: no signal must be sent to it
TEST(ChildProcess, SendsNoSignalToAnEndedChild) {
  for (const bool ignored : {false, true}) {
    testing::Child child([&] {
      if (ignored) ::signal(SIGCHLD, SIG_IGN);
      ChildProcess process(fork_to([] {})), running(fork_to(wait_for_ever));
      if (!test::die_of(SYS_kill)) return;
      if (process.pidfd() >= 0 && !ended(process)) ::_exit(1);
      process.end();
      running.end();
      if (::waitpid(-1, nullptr, 0) != -1 || errno != ECHILD) ::_exit(1);
    });
    EXPECT_TRUE(child.finished()) << ignored;
  }
}

}  // namespace
}  // namespace palpate
