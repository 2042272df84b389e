#include "palpate/supervisor/supervisor.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstring>
#include <new>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/base/child_process.h"
#include "palpate/base/clock.h"
#include "supervisor/shared_block.h"

namespace palpate {
namespace {

// generous start-up time for a busy machine
constexpr int kPatience_ms = 30'000;

/// Owning file descriptor; -1: none.
class File {
 public:
  explicit File(int number) : number_(number) {}
  ~File() {
    if (number_ >= 0) ::close(number_);
  }
  File(File&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  File& operator=(File&&) = delete;
  int number() const { return number_; }

 private:
  int number_;
};

Error refused(const std::string& what) {
  return {ErrorKind::kUnavailable, "no supervisor: " + what + ": " + std::strerror(errno), "",
          "close other programs, or raise the limits of processes and files (ulimit -u, ulimit -n)"};
}

class SupervisorProcess final : public Supervisor {
 public:
  SupervisorProcess(SharedBlock& block, File block_file, const SupervisorSettings& settings)
      : block_(block), block_file_(std::move(block_file)), settings_(settings) {}
  ~SupervisorProcess() override {
    block_.ended.store(true, std::memory_order_release);
    end();
    ::munmap(&block_, sizeof block_);
  }
  SupervisorProcess(const SupervisorProcess&) = delete;
  SupervisorProcess& operator=(const SupervisorProcess&) = delete;

  Result<void> begin();

  Heartbeat& heartbeat() noexcept override { return block_.heartbeat; }
  bool is_running() const noexcept override {
    pollfd ended{process_.pidfd(), POLLIN, 0};
    return process_.pidfd() >= 0 && ::poll(&ended, 1, 0) == 0;
  }
  Result<void> restart() override {
    if (is_running()) return {};
    end();
    return begin();
  }
  std::string scheduler() const override { return block_.scheduler.data(); }
  std::vector<SupervisorEvent> events() const override { return block_.all(); }

 private:
  void end();

  SharedBlock& block_;
  const File block_file_;
  const SupervisorSettings settings_;
  ChildProcess process_;
};

// a running supervisor polls once a millisecond and exits; a frozen one or another program is not waited for
void SupervisorProcess::end() {
  pollfd ended{process_.pidfd(), POLLIN, 0};
  const int patience_ms = block_.watching.load() ? 1000 : 0;
  if (process_.pidfd() >= 0) ::poll(&ended, 1, patience_ms);
  process_.end();
  block_.watching.store(false);
}

Result<void> SupervisorProcess::begin() {
  const File session(static_cast<int>(::syscall(SYS_pidfd_open, ::getpid(), 0)));
  if (session.number() < 0) return refused("cannot open a descriptor of this process");

  // duplicate above all target numbers, so that no descriptor is overwritten before it is duplicated
  std::vector<File> files;
  const int above = kFirstHaltFile + static_cast<int>(kMaxHaltFiles) + 1;
  const auto copy = [&](int file) {
    files.emplace_back(::fcntl(file, F_DUPFD_CLOEXEC, above));
    return files.back().number() >= 0;
  };
  bool copied = copy(block_file_.number()) && copy(session.number());
  for (const int file : settings_.halt_fds) copied = copied && copy(file);
  const bool record = settings_.event_log_fd >= 0;
  if (record) copied = copied && copy(settings_.event_log_fd);
  if (!copied) return refused("cannot duplicate its file descriptors");

  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  for (std::size_t n = 0; n < files.size(); ++n)
    ::posix_spawn_file_actions_adddup2(&actions, files[n].number(), kBlockFile + static_cast<int>(n));
  ::posix_spawn_file_actions_addclosefrom_np(&actions, kBlockFile + static_cast<int>(files.size()));
  // a new POSIX session: isolated from the terminal's signals
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK);
  sigset_t none;
  ::sigemptyset(&none);
  ::posix_spawnattr_setsigmask(&attributes, &none);

  std::vector<std::string> words = settings_.command;
  words.push_back(std::to_string(settings_.halt_fds.size()));
  words.emplace_back(settings_.kill_frozen ? "1" : "0");
  words.emplace_back(record ? "1" : "0");
  words.emplace_back(settings_.realtime ? "1" : "0");
  words.push_back(std::to_string(::getpid()));
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  pid_t process = -1;
  const int failed = ::posix_spawn(&process, arguments[0], &actions, &attributes, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  if (failed != 0) {
    errno = failed;
    return refused(words.front());
  }
  // free these descriptors for the following one
  files.clear();
  process_ = ChildProcess(process);
  if (process_.pidfd() < 0) return refused("cannot open a descriptor of its process");

  pollfd ended{process_.pidfd(), POLLIN, 0};
  for (int waited = 0; waited < kPatience_ms; ++waited) {
    if (block_.watching.load(std::memory_order_acquire)) return {};
    if (::poll(&ended, 1, 1) > 0) break;
  }
  return Error{ErrorKind::kUnavailable, "no supervisor: its process did not start to monitor", words.front(),
               "close other programs, and try again"};
}

}  // namespace

Result<std::unique_ptr<Supervisor>> Supervisor::start(const SupervisorSettings& settings) {
  PALPATE_CHECK(!settings.command.empty() && settings.halt_fds.size() <= kMaxHaltFiles);
  File file(::memfd_create("palpate-supervisor", MFD_CLOEXEC));
  if (file.number() < 0 || ::ftruncate(file.number(), sizeof(SharedBlock)) != 0)
    return refused("cannot create shared memory");
  void* memory = ::mmap(nullptr, sizeof(SharedBlock), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE,
                        file.number(), 0);
  if (memory == MAP_FAILED) return refused("cannot create shared memory");
  auto* block = new (memory) SharedBlock;
  // a device that received halts of an earlier supervisor only obeys larger numbers; numbering by nanoseconds
  // guarantees that
  block->heartbeat.newest_halt = block->heartbeat.newest_ended_halt =
      static_cast<std::uint64_t>(monotonic_ns());
  auto supervisor = std::make_unique<SupervisorProcess>(*block, std::move(file), settings);
  if (auto begun = supervisor->begin(); !begun) return begun.error();
  return std::unique_ptr<Supervisor>(std::move(supervisor));
}

}  // namespace palpate
