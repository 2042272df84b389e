#pragma once

#include <sys/types.h>

namespace palpate {

/// A child process, owned through a pidfd instead of its process id. The id may be reused as soon as the
/// child has ended if the host program ignores SIGCHLD or waits for any child; a pidfd always refers to the
/// same process. Where the kernel provides no pidfd (before Linux 5.3, some containers) the id is used.
class ChildProcess {
 public:
  ChildProcess() = default;         ///< No process.
  explicit ChildProcess(pid_t id);  ///< The child's process id.
  ~ChildProcess() { end(); }
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&& other) noexcept;

  /// Pidfd of the child, readable (poll) once it has ended; -1 without one.
  int pidfd() const { return pidfd_; }
  /// Kills the child with SIGKILL if it is still running, and waits until it has been reaped. Further calls
  /// have no effect.
  void end();

 private:
  pid_t id_ = -1;
  int pidfd_ = -1;
};

}  // namespace palpate
