#include "palpate/base/child_process.h"

#include <errno.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <utility>

namespace palpate {

ChildProcess::ChildProcess(pid_t id) : id_(id), file_(static_cast<int>(::syscall(SYS_pidfd_open, id, 0))) {
  // the child has ended and was already reaped, because this process ignores SIGCHLD
  if (file_ < 0 && errno == ESRCH) id_ = -1;
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : id_(std::exchange(other.id_, -1)), file_(std::exchange(other.file_, -1)) {}

ChildProcess& ChildProcess::operator=(ChildProcess&& other) noexcept {
  std::swap(id_, other.id_);
  std::swap(file_, other.file_);
  return *this;
}

void ChildProcess::end() {
  if (id_ <= 0) return;
  if (file_ >= 0)
    ::syscall(SYS_pidfd_send_signal, file_, SIGKILL, nullptr, 0);
  else
    ::kill(id_, SIGKILL);
  siginfo_t how{};
  const auto awaited = [&] {
    return file_ >= 0 ? ::waitid(P_PIDFD, static_cast<id_t>(file_), &how, WEXITED)
                      : ::waitid(P_PID, static_cast<id_t>(id_), &how, WEXITED);
  };
  while (awaited() != 0 && errno == EINTR) {
  }
  id_ = -1;
  if (file_ >= 0) ::close(std::exchange(file_, -1));
}

}  // namespace palpate
