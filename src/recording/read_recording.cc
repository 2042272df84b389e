#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fstream>
#include <functional>
#include <new>
#include <system_error>

#include "base/file.h"
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

std::optional<Error> not_hdf5(const InputFile& opened, const std::filesystem::path& file) {
  // HDF5's signature stands at 0, 512, 1024, 2048, ...
  for (std::uint64_t at = 0; at < opened.size(); at = at == 0 ? 512 : 2 * at) {
    std::array<std::byte, 8> bytes{};
    if (const auto got = opened.read_at(at, bytes); !got) return got.error();
    if (std::memcmp(bytes.data(), "\x89HDF\r\n\x1a\n", bytes.size()) == 0) return std::nullopt;
  }
  return Error{ErrorKind::kBadInput, "is not a recording: it is no HDF5 file", file.string(),
               "name a file that palpate simulate or explore wrote"};
}

// the process that opens the file, and the end of its pipe
class Child {
 public:
  explicit Child(const InputFile& file) {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) return;
    {
      const Hdf5Section section;
      id_ = ::fork();
      if (id_ == 0) run_child(file.name_for_libraries(), ends[1]);
    }
    ::close(ends[1]);
    pipe_ = ends[0];
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  // it has ended, or what it is still doing is of no use
  ~Child() {
    if (pipe_ >= 0) ::close(pipe_);
    if (!started()) return;
    ::kill(id_, SIGKILL);
    while (::waitpid(id_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  bool started() const { return id_ > 0; }
  int pipe() const { return pipe_; }

 private:
  pid_t id_ = -1;
  int pipe_ = -1;
};

using TakeHead = std::function<Result<bool>(const RecordingHead&)>;
using TakePart = std::function<Result<void>(const RecordingPart&)>;

// what is wrong with the file, or with what is read; not with what is made of it
Error about(const std::filesystem::path& file, Error error) {
  if (error.kind != ErrorKind::kInterrupted) error.where = file.string();
  return error;
}

/// @param take_head  says whether the parts are wanted too
Result<void> read_isolated(const std::filesystem::path& file, const TakeHead& take_head,
                           const TakePart& take_part, const Progress& progress) try {
  const auto opened = InputFile::open(file);
  if (!opened) return opened.error();
  if (auto error = not_hdf5(*opened, file)) return *error;
  const Child child(*opened);
  if (!child.started())
    return Error{ErrorKind::kUnavailable, std::string("no process to read it in: ") + std::strerror(errno),
                 file.string(), ""};
  PipeSource source(child.pipe(), progress);
  auto received = receive_head(source);
  if (!received) return about(file, received.error());
  const RecordingHead head = *std::move(received);
  const auto wanted = take_head(head);
  if (!wanted) return wanted.error();
  if (!*wanted) return {};
  bool own_error = false;
  auto done = receive_parts(
      source, head,
      [&](const RecordingPart& part) {
        auto taken = take_part(part);
        own_error = !taken;
        return taken;
      },
      progress);
  if (done || own_error) return done;
  return about(file, done.error());
} catch (const std::bad_alloc&) {
  return Error{ErrorKind::kBadInput, "the recording does not fit in memory", file.string(), ""};
}

std::filesystem::file_time_type last_change(const std::filesystem::path& file) {
  std::error_code failed;
  return std::filesystem::last_write_time(file, failed);
}

bool same_run(const RecordingHeader& a, const RecordingHeader& b) {
  return a.started_utc == b.started_utc && a.model_hash == b.model_hash && a.seed == b.seed &&
         a.devices == b.devices && a.script_text == b.script_text;
}

}  // namespace
}  // namespace internal

Result<RecordingSource> RecordingSource::open(const std::filesystem::path& file, const Progress& progress) {
  RecordingHead head;
  const auto take_head = [&](const RecordingHead& read) -> Result<bool> {
    head = read;
    return false;
  };
  // a reader that is slow beside the writer may meet an index in the middle of a change: it looks again
  constexpr int kMostLooks = 20;
  for (int look = 1;; ++look) {
    const auto before = internal::last_change(file);
    const auto read = internal::read_isolated(file, take_head, {}, progress);
    if (read) return RecordingSource(file, std::move(head));
    const bool was_written = internal::last_change(file) != before;
    if (read.error().kind != ErrorKind::kBadInput || !was_written || look == kMostLooks) return read.error();
  }
}

RecordingSource::RecordingSource(const Recording& recording) : memory_(&recording) {
  head_.header = recording.header;
  head_.summary = recording.summary;
  internal::TicksSeen seen;
  for (const TickRecord& tick : recording.ticks) seen.see(tick.tick, tick.time_s, tick.method);
  seen.tell(head_);
}

Result<void> RecordingSource::read(const std::function<Result<void>(const RecordingPart&)>& take,
                                   const Progress& progress) const {
  // as many ticks as the head tells of, and their events
  std::uint64_t left = head_.ticks;
  const auto take_known = [&](RecordingPart part) -> Result<void> {
    if (left == 0) return {};
    if (part.ticks.size() > left) {
      part.ticks = part.ticks.first(static_cast<std::size_t>(left));
      part.events = part.events.first(internal::events_up_to(part.events, part.ticks.back().tick));
    }
    left -= part.ticks.size();
    return take(part);
  };
  if (memory_ == nullptr) {
    const auto take_head = [&](const RecordingHead& now) -> Result<bool> {
      if (internal::same_run(now.header, head_.header) && now.ticks >= head_.ticks) return true;
      return Error{ErrorKind::kBadInput, "another recording has taken its place while it was read",
                   file_.string(), "try again when nothing writes to it"};
    };
    return internal::read_isolated(file_, take_head, take_known, progress);
  }

  std::span<const TickRecord> ticks(memory_->ticks);
  std::span<const RecordingEvent> events(memory_->events);
  while (!ticks.empty()) {
    if (progress.stopped()) return Progress::interrupted();
    const auto part = ticks.first(std::min<std::size_t>(ticks.size(), internal::kBlockRows));
    const std::size_t told = internal::events_up_to(events, part.back().tick);
    if (auto taken = take_known({part, events.first(told)}); !taken) return taken;
    ticks = ticks.subspan(part.size());
    events = events.subspan(told);
  }
  return {};
}

Result<Recording> read_recording(const std::filesystem::path& file, const Progress& progress) {
  Recording recording;
  double all = 0;
  const auto take_head = [&](const RecordingHead& head) -> Result<bool> {
    recording.header = head.header;
    recording.summary = head.summary;
    all = static_cast<double>(head.ticks);
    return true;
  };
  // memory is taken as the rows arrive, not as their number promises
  const auto take_part = [&](const RecordingPart& part) -> Result<void> {
    progress.report("reading the recording", static_cast<double>(recording.ticks.size()) / all);
    recording.ticks.insert(recording.ticks.end(), part.ticks.begin(), part.ticks.end());
    recording.events.insert(recording.events.end(), part.events.begin(), part.events.end());
    return {};
  };
  if (auto read = internal::read_isolated(file, take_head, take_part, progress); !read) return read.error();
  return recording;
}

}  // namespace palpate
