#pragma once

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <functional>

/// Processes of the tests' own.
namespace palpate::test {

/// Kills a child process wherever it is but in the middle of a write: there Linux would stop at the border
/// between two pages (docs/reference/recording.md, limits). Returns when it is gone.
inline void kill_between_writes(pid_t child) {
  // to stand still it first comes to the end of its system call
  int status = 0;
  ::kill(child, SIGSTOP);
  ::waitpid(child, &status, WUNTRACED);
  if (!WIFSTOPPED(status)) return;
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
}

/// The most memory, MiB, that a copy of this process had while it did `work`; a negative number where that
/// was not done.
inline double peak_memory_of(const std::function<bool()>& work) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(work() ? 0 : 1);
  int status = 0;
  rusage used{};
  if (child < 0 || ::wait4(child, &status, 0, &used) != child || status != 0) return -1;
  return static_cast<double>(used.ru_maxrss) / 1024;
}

}  // namespace palpate::test
