#pragma once

#include <sys/types.h>

namespace palpate {

/// A process that this one has begun, held by a file of its own and not by its number: that may be another
/// process's as soon as it has ended, where the program that palpate is part of ignores SIGCHLD or waits for
/// whatever ends. Only a kernel that gives no such file (before Linux 5.3, some containers) leaves the
/// number.
class ChildProcess {
 public:
  ChildProcess() = default;  ///< none
  explicit ChildProcess(pid_t id);
  ~ChildProcess() { end(); }
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&& other) noexcept;

  /// Readable when it has ended; -1: there is none.
  int file() const { return file_; }
  /// Kills it, where it has not ended, and returns when nothing of it is left. More than once does nothing.
  void end();

 private:
  pid_t id_ = -1;
  int file_ = -1;
};

}  // namespace palpate
