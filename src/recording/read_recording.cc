#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fstream>
#include <new>

#include "recording/hdf5_handle.h"
#include "recording/hdf5_reader.h"

// HDF5 is not safe against hostile files, so a child process opens them: it may crash, loop or swallow
// memory. The parent takes plain rows from a pipe (stream.h) and believes none of them unchecked.
namespace palpate {
namespace internal {
namespace {

constexpr rlim_t kChildMemory = rlim_t{1} << 30;  // beyond what the parent has, bytes
constexpr int kPollMs = 100;
constexpr int kPatienceMs = 20'000;  // without a byte from the child

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif
#else
constexpr bool kSanitized = false;
#endif

class PipeTarget : public ByteTarget {
 public:
  explicit PipeTarget(int descriptor) : descriptor_(descriptor) {}
  bool write(std::span<const std::byte> bytes) override {
    while (!bytes.empty()) {
      const ssize_t wrote = ::write(descriptor_, bytes.data(), bytes.size());
      if (wrote < 0 && errno == EINTR) continue;
      if (wrote <= 0) return false;
      bytes = bytes.subspan(static_cast<std::size_t>(wrote));
    }
    return true;
  }

 private:
  int descriptor_;
};

class PipeSource : public ByteSource {
 public:
  PipeSource(int descriptor, const Progress& progress) : descriptor_(descriptor), progress_(progress) {}

  Result<void> read(std::span<std::byte> bytes) override {
    while (!bytes.empty()) {
      if (auto ready = wait(); !ready) return ready;
      const ssize_t got = ::read(descriptor_, bytes.data(), bytes.size());
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return damaged("HDF5 fails on it");
      bytes = bytes.subspan(static_cast<std::size_t>(got));
    }
    return {};
  }

 private:
  static Error damaged(const std::string& what) {
    return {ErrorKind::kBadInput, "the recording is damaged: " + what, "", ""};
  }

  // until there is something to read, in short steps so that a suspended program does not lose patience
  Result<void> wait() {
    for (int waited = 0; waited < kPatienceMs; waited += kPollMs) {
      if (progress_.stopped()) return Progress::interrupted();
      pollfd pipe{descriptor_, POLLIN, 0};
      if (::poll(&pipe, 1, kPollMs) > 0) return {};
    }
    return damaged("HDF5 does not come to an end with it");
  }

  int descriptor_;
  const Progress& progress_;
};

// Everything that keeps a process led astray from doing harm: no memory without end, no messages, no
// core file with a patient in it, no life after the parent.
void confine() {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::prctl(PR_SET_DUMPABLE, 0);
  for (const int signal : {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL, SIGALRM, SIGPIPE})
    ::signal(signal, SIG_DFL);
  const int nothing = ::open("/dev/null", O_RDWR);
  for (const int descriptor : {0, 1, 2}) ::dup2(nothing, descriptor);
  // sanitizers reserve terabytes of addresses
  if (kSanitized) return;
  rlim_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  const rlim_t most = pages * static_cast<rlim_t>(::sysconf(_SC_PAGESIZE)) + kChildMemory;
  const rlimit limit{most, most};
  ::setrlimit(RLIMIT_AS, &limit);
}

[[noreturn]] void run_child(const std::filesystem::path& file, int descriptor) {
  bool sent = false;
  try {
    confine();
    PipeTarget target(descriptor);
    sent = send_recording(file, target);
  } catch (...) {
    // out of memory; the parent sees the pipe end early
  }
  ::_exit(sent ? 0 : 1);
}

std::optional<Error> not_hdf5(const std::filesystem::path& file) {
  const auto bad = [&](std::string what, std::string remedy) {
    return Error{ErrorKind::kBadInput, std::move(what), file.string(), std::move(remedy)};
  };
  struct stat status;
  if (::stat(file.c_str(), &status) != 0)
    return errno == ENOENT ? bad("no such file", "check the name and the folder")
                           : bad(std::string("cannot be read: ") + std::strerror(errno), "");
  if (S_ISDIR(status.st_mode)) return bad("is a folder, not a file", "name a file in it");
  if (!S_ISREG(status.st_mode)) return bad("is not a plain file", "name a recording");

  // HDF5's signature stands at 0, 512, 1024, 2048, ...
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return bad("cannot be read", "check its permissions");
  for (std::streamoff at = 0; at < status.st_size; at = at == 0 ? 512 : 2 * at) {
    char bytes[8] = {};
    stream.seekg(at);
    stream.read(bytes, sizeof bytes);
    if (std::memcmp(bytes, "\x89HDF\r\n\x1a\n", sizeof bytes) == 0) return std::nullopt;
    stream.clear();
  }
  return bad("is not a recording: it is no HDF5 file", "name a file that palpate simulate or explore wrote");
}

struct Child {
  pid_t id = -1;
  int pipe = -1;
};

Child start_child(const std::filesystem::path& file) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return {};
  pid_t id;
  {
    const Hdf5Section section;
    id = ::fork();
    if (id == 0) run_child(file, ends[1]);
  }
  ::close(ends[1]);
  if (id < 0) ::close(ends[0]);
  return {id, ends[0]};
}

Result<Recording> read_isolated(const std::filesystem::path& file, const Progress& progress) {
  const Child child = start_child(file);
  if (child.id < 0)
    return Error{ErrorKind::kUnavailable, std::string("no process to read it in: ") + std::strerror(errno),
                 "", ""};
  Result<Recording> recording = Error{ErrorKind::kBadInput, "the recording does not fit in memory", "", ""};
  try {
    PipeSource source(child.pipe, progress);
    recording = receive_recording(source, progress);
  } catch (const std::bad_alloc&) {
    // the error above
  }
  // it has ended, or what it is still doing is of no use
  ::close(child.pipe);
  ::kill(child.id, SIGKILL);
  while (::waitpid(child.id, nullptr, 0) < 0 && errno == EINTR) {
  }
  return recording;
}

}  // namespace
}  // namespace internal

Result<Recording> read_recording(const std::filesystem::path& file, const Progress& progress) {
  if (auto error = internal::not_hdf5(file)) return *error;
  Result<Recording> recording = internal::read_isolated(file, progress);
  if (recording || recording.error().kind == ErrorKind::kInterrupted) return recording;
  Error error = recording.error();
  error.where = file.string();
  return error;
}

}  // namespace palpate
