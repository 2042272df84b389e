#include "palpate/reader/reader_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <vector>

#include "reader/confine.h"

namespace palpate::reader {
namespace {

constexpr std::chrono::milliseconds kPoll{100};

Error no_process() {
  return {ErrorKind::kUnavailable, std::string("cannot start a process to read it: ") + std::strerror(errno),
          "", "close other programs, or raise the limits of processes and files (ulimit -u, ulimit -n)"};
}

[[noreturn]] void run(int parent, ParentEnd& end, std::span<const int> retained_descriptors,
                      std::span<const int> files, const ReaderProcess::Work& work) {
  bool done = false;
  try {
    confine(parent, retained_descriptors, files);
    done = work(end);
  } catch (...) {
    // out of memory; the parent detects the early end of the pipe
  }
  ::_exit(done ? 0 : 1);
}

}  // namespace

bool ParentEnd::write(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t wrote = ::write(pipe_, bytes.data(), bytes.size());
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(wrote));
  }
  return true;
}

bool ParentEnd::wait_for_grant() {
  std::uint64_t word = 0;
  while (true) {
    pollfd grants{grants_, POLLIN, 0};
    if (::poll(&grants, 1, -1) < 0 && errno != EINTR) return false;
    if (::read(grants_, &word, sizeof word) == sizeof word) return true;
    if (errno != EAGAIN && errno != EINTR) return false;
  }
}

Result<std::unique_ptr<ReaderProcess>> ReaderProcess::start(const Job& job, const Work& work,
                                                            const Progress& progress) {
  std::unique_ptr<ReaderProcess> process(new ReaderProcess(progress));
  process->death_error_ = job.death_error;
  process->timeout_error_ = job.timeout_error;
  process->timeout_ = job.timeout;
  if (job.shared_bytes > 0) {
    // anonymous, so that no process can change its size
    void* shared =
        ::mmap(nullptr, job.shared_bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) return no_process();
    process->shared_ = {static_cast<std::byte*>(shared), job.shared_bytes};
  }
  // Non-blocking: the process has it too and could fill it, and the parent must never wait for it.
  process->grants_ = ::eventfd(0, EFD_CLOEXEC | EFD_SEMAPHORE | EFD_NONBLOCK);
  int ends[2];
  if (process->grants_ < 0 || ::pipe2(ends, O_CLOEXEC) != 0) return no_process();
  process->pipe_ = ends[0];

  std::vector<int> retained_descriptors(job.files.begin(), job.files.end());
  retained_descriptors.insert(retained_descriptors.end(), {ends[1], process->grants_});
  const pid_t parent = ::getpid();
  const pid_t child = ::fork();
  if (child == 0) {
    ParentEnd end(ends[1], process->grants_, process->shared_);
    run(parent, end, retained_descriptors, job.files, work);
  }
  const auto failure = no_process();
  ::close(ends[1]);
  if (child < 0) return failure;
  process->process_ = ChildProcess(child);
  return process;
}

ReaderProcess::~ReaderProcess() {
  // the process has ended, or its result is no longer needed
  process_.end();
  for (const int descriptor : {pipe_, grants_})
    if (descriptor >= 0) ::close(descriptor);
  if (!shared_.empty()) ::munmap(shared_.data(), shared_.size());
}

Result<void> ReaderProcess::read(std::span<std::byte> bytes) {
  while (!bytes.empty()) {
    if (auto ready = wait(); !ready) return ready;
    const ssize_t received = ::read(pipe_, bytes.data(), bytes.size());
    if (received < 0 && errno == EINTR) continue;
    if (received <= 0) return Error{ErrorKind::kBadInput, death_error_, "", ""};
    bytes = bytes.subspan(static_cast<std::size_t>(received));
  }
  return {};
}

void ReaderProcess::resume() const {
  const std::uint64_t once = 1;
  // fails only if the process itself has filled the counter, which then allows it to continue anyway
  while (::write(grants_, &once, sizeof once) < 0 && errno == EINTR) {
  }
}

// waits for data, in short steps so that a suspended program does not exceed `timeout`
Result<void> ReaderProcess::wait() const {
  for (std::chrono::milliseconds waited{0}; waited < timeout_; waited += kPoll) {
    if (progress_.stopped()) return Progress::interrupted();
    pollfd pipe{pipe_, POLLIN, 0};
    if (::poll(&pipe, 1, static_cast<int>(kPoll.count())) > 0) return {};
  }
  return Error{ErrorKind::kBadInput, timeout_error_, "", ""};
}

}  // namespace palpate::reader
