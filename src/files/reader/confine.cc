#include "reader/confine.h"

#include <fcntl.h>
#include <linux/landlock.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <fstream>
#include <vector>

namespace palpate::reader {
namespace {

constexpr rlim_t kMoreMemory = rlim_t{1} << 30;  // allowance beyond the parent's memory; bytes
constexpr rlim_t kDescriptors = 64;

// All access rights of Landlock's first version: a right that is listed here and granted by no rule is
// denied.
constexpr std::uint64_t kHandled = (LANDLOCK_ACCESS_FS_MAKE_SYM << 1) - 1;
static_assert(kHandled & LANDLOCK_ACCESS_FS_EXECUTE);

int landlock_version() {
  return static_cast<int>(
      ::syscall(SYS_landlock_create_ruleset, nullptr, std::size_t{0}, LANDLOCK_CREATE_RULESET_VERSION));
}

// Restricts file access by Landlock. Rules refer to the files themselves and not to their names: another file
// that replaces one of them cannot be opened.
void restrict_files(std::span<const int> files) {
  landlock_ruleset_attr handled{};
  handled.handled_access_fs = kHandled;
  // later versions of the structure have more members, which stay zero, as the first version requires
  const int rules = static_cast<int>(
      ::syscall(SYS_landlock_create_ruleset, &handled, sizeof handled.handled_access_fs, 0u));
  if (rules < 0) return;
  for (const int file : files) {
    landlock_path_beneath_attr rule{};
    rule.allowed_access = LANDLOCK_ACCESS_FS_READ_FILE;
    rule.parent_fd = file;
    ::syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0u);
  }
  ::syscall(SYS_landlock_restrict_self, rules, 0u);
  ::close(rules);
}

// signals from the terminal are meant for the parent, which ends this process when it no longer needs it
void reset_signal_handlers() {
  for (int signal = 1; signal < NSIG; ++signal) ::signal(signal, SIG_DFL);
  for (const int signal : {SIGINT, SIGQUIT, SIGHUP}) ::signal(signal, SIG_IGN);
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
}

void close_all_but(std::span<const int> retained_descriptors) {
  std::vector<int> sorted(retained_descriptors.begin(), retained_descriptors.end());
  std::sort(sorted.begin(), sorted.end());
  const int nothing = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  for (const int descriptor : {0, 1, 2}) {
    // the program may have been started with this descriptor closed
    if (std::binary_search(sorted.begin(), sorted.end(), descriptor)) continue;
    // sanitizers report on stderr
    if (descriptor == 2 && sanitized()) continue;
    if (::dup2(nothing, descriptor) < 0) ::close(descriptor);
  }
  unsigned first = 3;
  for (const int descriptor : sorted) {
    if (descriptor < static_cast<int>(first)) continue;
    if (descriptor > static_cast<int>(first)) ::close_range(first, static_cast<unsigned>(descriptor) - 1, 0);
    first = static_cast<unsigned>(descriptor) + 1;
  }
  ::close_range(first, ~0u, 0);
}

void limit(__rlimit_resource_t what, rlim_t most) {
  const rlimit both{most, most};
  ::setrlimit(what, &both);
}

rlim_t memory_now() {
  rlim_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<rlim_t>(::sysconf(_SC_PAGESIZE));
}

}  // namespace

bool sanitized() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
  return true;
#else
  return false;
#endif
#else
  return false;
#endif
}

bool can_restrict_files() {
  return landlock_version() >= 1;
}

void confine(int parent, std::span<const int> retained_descriptors, std::span<const int> files) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  // the parent may have ended before PR_SET_PDEATHSIG took effect
  if (::getppid() != parent) ::_exit(1);
  ::prctl(PR_SET_DUMPABLE, 0);
  reset_signal_handlers();
  close_all_but(retained_descriptors);
  limit(RLIMIT_CORE, 0);
  if (sanitized()) return;
  limit(RLIMIT_AS, memory_now() + kMoreMemory);
  limit(RLIMIT_FSIZE, 0);
  limit(RLIMIT_NOFILE, kDescriptors);
  limit(RLIMIT_NPROC, 0);
  // required for Landlock and seccomp
  if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return;
  restrict_files(files);
  restrict_system_calls();
}

}  // namespace palpate::reader
