#pragma once

#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstddef>

/// Restrictions that a process imposes on itself irrevocably: for a Child, never for the test process.
namespace palpate::test {

/// From now on this process is killed by the system call with this number. False if the kernel has no
/// seccomp.
inline bool die_of(unsigned number) {
  std::array code{sock_filter BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
                  sock_filter BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, number, 0, 1),
                  sock_filter BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
                  sock_filter BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)};
  sock_fprog program{static_cast<unsigned short>(code.size()), code.data()};
  return ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
         ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

/// From now on this process can create no further process; root, which is exempt from the limit, first
/// becomes nobody. False if a process can still be created.
inline bool forbid_processes() {
  constexpr unsigned kNobody = 65534;
  const rlimit none{0, 0};
  if (::setrlimit(RLIMIT_NPROC, &none) != 0) return false;
  if (::geteuid() == 0 && (::setgid(kNobody) != 0 || ::setuid(kNobody) != 0)) return false;
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  const bool forbidden = child < 0 && errno == EAGAIN;
  if (child > 0) ::waitpid(child, nullptr, 0);
  return forbidden;
}

}  // namespace palpate::test
