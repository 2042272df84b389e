#include "palpate/base/child_process.h"

#include <errno.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <utility>

namespace palpate {

ChildProcess::ChildProcess(pid_t id) : id_(id), pidfd_(static_cast<int>(::syscall(SYS_pidfd_open, id, 0))) {
  // the child has ended and was already reaped, because this process ignores SIGCHLD
  if (pidfd_ < 0 && errno == ESRCH) id_ = -1;
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : id_(std::exchange(other.id_, -1)), pidfd_(std::exchange(other.pidfd_, -1)) {}

ChildProcess& ChildProcess::operator=(ChildProcess&& other) noexcept {
  std::swap(id_, other.id_);
  std::swap(pidfd_, other.pidfd_);
  return *this;
}

void ChildProcess::end() {
  if (id_ <= 0) return;
  if (pidfd_ >= 0)
    ::syscall(SYS_pidfd_send_signal, pidfd_, SIGKILL, nullptr, 0);
  else
    ::kill(id_, SIGKILL);
  siginfo_t how{};
  const auto awaited = [&] {
    return pidfd_ >= 0 ? ::waitid(P_PIDFD, static_cast<id_t>(pidfd_), &how, WEXITED)
                       : ::waitid(P_PID, static_cast<id_t>(id_), &how, WEXITED);
  };
  while (awaited() != 0 && errno == EINTR) {
  }
  id_ = -1;
  if (pidfd_ >= 0) ::close(std::exchange(pidfd_, -1));
}

}  // namespace palpate
