#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "reader/confine.h"

namespace palpate::reader {
namespace {

#if defined(__x86_64__)
constexpr std::uint32_t kMachine = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr std::uint32_t kMachine = AUDIT_ARCH_AARCH64;
#else
// matches no machine: no filter is installed
constexpr std::uint32_t kMachine = 0;
#endif
static_assert(std::endian::native == std::endian::little,
              "the filter compares the lower half of 64-bit arguments");

constexpr std::uint32_t kRefuse = SECCOMP_RET_ERRNO | EPERM;

// Offsets into seccomp_data. Of an argument the lower half is tested, which contains all of an int.
constexpr std::uint32_t kNumber = offsetof(seccomp_data, nr);
constexpr std::uint32_t kArchitecture = offsetof(seccomp_data, arch);
constexpr std::uint32_t argument(std::uint32_t n) {
  return offsetof(seccomp_data, args) + n * static_cast<std::uint32_t>(sizeof(std::uint64_t));
}
constexpr std::uint32_t upper_half(std::uint32_t n) {
  return argument(n) + 4;
}

// System calls allowed with any arguments: none opens, names, starts or reaches anything.
constexpr long kHarmless[] = {
    // open descriptors
    __NR_read,
    __NR_write,
    __NR_readv,
    __NR_writev,
    __NR_pread64,
    __NR_lseek,
    __NR_fstat,
    __NR_close,
    __NR_ppoll,
    // metadata by name, which Landlock does not hide
    __NR_newfstatat,
    __NR_statx,
    __NR_readlinkat,
    __NR_getcwd,
    // memory
    __NR_munmap,
    __NR_mremap,
    __NR_brk,
    __NR_madvise,
    // threads and signals of this process
    __NR_futex,
    __NR_rt_sigaction,
    __NR_rt_sigprocmask,
    __NR_rt_sigreturn,
    __NR_restart_syscall,
    __NR_sched_yield,
    __NR_sched_getaffinity,
    __NR_getpid,
    __NR_gettid,
    __NR_getppid,
    // time and random numbers
    __NR_clock_gettime,
    __NR_clock_nanosleep,
    __NR_gettimeofday,
    __NR_getrandom,
    // exit
    __NR_exit,
    __NR_exit_group,
#if defined(__x86_64__)
    __NR_poll,
    __NR_stat,
    __NR_lstat,
    __NR_readlink,
    __NR_time,
#endif
};

// seccomp filter program, built instruction by instruction
class Filter {
 public:
  void load(std::uint32_t offset) { add(BPF_LD | BPF_W | BPF_ABS, offset, 0, 0); }
  void return_action(std::uint32_t action) { add(BPF_RET | BPF_K, action, 0, 0); }
  // return immediately if the loaded word is equal, different, or has one of the bits
  void return_if(std::uint32_t word, std::uint32_t action) {
    add(BPF_JMP | BPF_JEQ | BPF_K, word, 0, 1);
    return_action(action);
  }
  void return_unless(std::uint32_t word, std::uint32_t action) {
    add(BPF_JMP | BPF_JEQ | BPF_K, word, 1, 0);
    return_action(action);
  }
  void return_if_any(std::uint32_t bits, std::uint32_t action) {
    add(BPF_JMP | BPF_JSET | BPF_K, bits, 0, 1);
    return_action(action);
  }
  // Adds `rules` for one system call, which must return for all of its arguments: for other calls the call
  // number stays loaded.
  template <class Rules>
  void for_call(long number, const Rules& rules) {
    add(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(number), 0, 0);
    const std::size_t jump = code_.size() - 1;
    rules();
    code_[jump].jf = static_cast<std::uint8_t>(code_.size() - 1 - jump);
  }
  bool install() {
    const sock_fprog program{static_cast<unsigned short>(code_.size()), code_.data()};
    return ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
  }

 private:
  void add(int code, std::uint32_t k, std::uint8_t jt, std::uint8_t jf) {
    code_.push_back({static_cast<std::uint16_t>(code), jt, jf, k});
  }
  std::vector<sock_filter> code_;
};

Filter filter_for(std::uint32_t own_process) {
  Filter filter;
  filter.load(kArchitecture);
  filter.return_unless(kMachine, kRefuse);
  filter.load(kNumber);
  for (const long call : kHarmless) filter.return_if(static_cast<std::uint32_t>(call), SECCOMP_RET_ALLOW);

  // read only
  filter.for_call(__NR_openat, [&] {
    filter.load(argument(2));
    filter.return_if_any(O_ACCMODE | O_CREAT | O_TRUNC | (__O_TMPFILE & ~O_DIRECTORY), kRefuse);
    filter.return_action(SECCOMP_RET_ALLOW);
  });
  // never executable memory
  for (const long call : {long{__NR_mmap}, long{__NR_mprotect}})
    filter.for_call(call, [&] {
      filter.load(argument(2));
      filter.return_if_any(PROT_EXEC, kRefuse);
      filter.return_action(SECCOMP_RET_ALLOW);
    });
  // abort() in this process, but no signal to another
  filter.for_call(__NR_tgkill, [&] {
    filter.load(argument(0));
    filter.return_unless(own_process, kRefuse);
    filter.return_action(SECCOMP_RET_ALLOW);
  });
  // descriptor flags, but not the signal owner
  filter.for_call(__NR_fcntl, [&] {
    filter.load(argument(1));
    for (const std::uint32_t command : {F_GETFD, F_SETFD, F_GETFL})
      filter.return_if(command, SECCOMP_RET_ALLOW);
    filter.return_action(kRefuse);
  });
  // limits may be queried, not set
  filter.for_call(__NR_prlimit64, [&] {
    for (const std::uint32_t half : {argument(2), upper_half(2)}) {
      filter.load(half);
      filter.return_unless(0, kRefuse);
    }
    filter.return_action(SECCOMP_RET_ALLOW);
  });
  filter.return_action(kRefuse);
  return filter;
}

}  // namespace

bool can_restrict_system_calls() {
  // a null filter: kernels with seccomp filters report the bad address (EFAULT)
  return kMachine != 0 && ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, nullptr) != 0 && errno == EFAULT;
}

bool restrict_system_calls() {
  return kMachine != 0 && filter_for(static_cast<std::uint32_t>(::getpid())).install();
}

}  // namespace palpate::reader
