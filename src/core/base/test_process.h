#pragma once

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <functional>

/// Processes that tests create.
namespace palpate::test {

/// Kills a child process at an arbitrary point except within a write, which Linux would cut at a page
/// boundary (docs/reference/recording.md, limits). Returns once it has ended.
inline void kill_between_writes(pid_t child) {
  // the child stops only after completing its system call
  int status = 0;
  ::kill(child, SIGSTOP);
  ::waitpid(child, &status, WUNTRACED);
  if (!WIFSTOPPED(status)) return;
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
}

/// Peak memory of a copy of this process while it executes `work`; MiB. Negative if `work` failed.
inline double peak_memory_of(const std::function<bool()>& work) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(work() ? 0 : 1);
  int status = 0;
  rusage used{};
  if (child < 0 || ::wait4(child, &status, 0, &used) != child || status != 0) return -1;
  return static_cast<double>(used.ru_maxrss) / 1024;
}

}  // namespace palpate::test
