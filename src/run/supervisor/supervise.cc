#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <optional>

#include "palpate/base/clock.h"
#include "palpate/servo/realtime.h"
#include "supervisor/shared_block.h"

namespace palpate {
namespace {

constexpr timespec kPollInterval{0, 1'000'000};
// upper bound of what one poll adds to the time without observations: if the whole machine stalled, the
// session is not to blame
constexpr std::int64_t kMaxPerCheck_ns = 5'000'000;
constexpr std::int64_t kFrozen_ns = 500'000'000;
// above the loop's watchdog, whose priority is above the servo's
constexpr int kPriority = 95;

const char* name_of(SupervisorEvent::Kind kind) {
  switch (kind) {
    case SupervisorEvent::Kind::kStall:
      return "stall";
    case SupervisorEvent::Kind::kDeath:
      return "death";
    case SupervisorEvent::Kind::kKilled:
      return "killed";
  }
  return "";
}

/// Writes the events to the record file on an ordinary thread, so that a slow disk cannot block the watching
/// thread.
class EventLogWriter {
 public:
  EventLogWriter(const SharedBlock& block, int file, int session)
      : block_(block), file_(file), session_(session), written_(block.event_count.load()) {}
  EventLogWriter(const EventLogWriter&) = delete;
  EventLogWriter& operator=(const EventLogWriter&) = delete;

  /// Call before this thread becomes real-time, so that the new thread stays ordinary.
  void begin() {
    // the stack counts towards the process's locked memory
    constexpr std::size_t kStack_bytes = 256 << 10;
    sigset_t all, before;
    ::sigfillset(&all);
    ::pthread_sigmask(SIG_SETMASK, &all, &before);
    pthread_attr_t attributes;
    ::pthread_attr_init(&attributes);
    ::pthread_attr_setstacksize(&attributes, kStack_bytes);
    failure_ = ::pthread_create(
        &thread_, &attributes,
        [](void* self) -> void* {
          static_cast<EventLogWriter*>(self)->run();
          return nullptr;
        },
        this);
    begun_ = failure_ == 0;
    ::pthread_attr_destroy(&attributes);
    ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
  }

  /// Call after the last event. Returns the errno of the first event missing in the file; 0: complete. The
  /// process has to exit afterwards, because a thread blocked by its disk is abandoned.
  int end() {
    if (!begun_) return written_ == block_.event_count.load() ? 0 : failure_.load();
    ending_.store(true);
    timespec until{};
    ::clock_gettime(CLOCK_REALTIME, &until);
    until.tv_sec += kPatience_s;
    const int late = ::pthread_timedjoin_np(thread_, nullptr, &until);
    return late != 0 ? late : failure_.load();
  }

 private:
  static constexpr int kPatience_s = 10;

  void run() noexcept {
    for (bool last = false; !last;) {
      last = ending_.load();
      const std::uint32_t count = block_.event_count.load(std::memory_order_acquire);
      // older events have been overwritten
      if (count - written_ > SharedBlock::kMaxEvents) {
        fail(EOVERFLOW);
        written_ = count - SharedBlock::kMaxEvents;
      }
      for (; written_ != count; ++written_) write_down(block_.events[written_ % SharedBlock::kMaxEvents]);
      constexpr timespec kPause{0, 10'000'000};
      if (!last) ::nanosleep(&kPause, nullptr);
    }
  }

  // all or nothing, since another session's lines may follow
  void write_down(const SupervisorEvent& event) {
    const std::time_t now = std::time(nullptr);
    std::tm utc{};
    ::gmtime_r(&now, &utc);
    std::array<char, 32> time{};
    std::strftime(time.data(), time.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
    std::array<char, 256> line{};
    const int length = std::snprintf(
        line.data(), line.size(),
        R"({"kind": "%s", "last_beat_ns": %lld, "observed_ns": %lld, "halted_ns": %lld, "session": %d, "utc": "%s"})"
        "\n",
        name_of(event.kind), static_cast<long long>(event.last_beat_ns),
        static_cast<long long>(event.observed_ns), static_cast<long long>(event.halted_ns), session_,
        time.data());
    struct stat before {};
    const bool is_regular_file = ::fstat(file_, &before) == 0 && S_ISREG(before.st_mode);
    const ssize_t written = ::write(file_, line.data(), static_cast<std::size_t>(length));
    if (written == length) return;
    fail(written < 0 ? errno : ENOSPC);
    if (written > 0 && is_regular_file) [[maybe_unused]]
      const int cut = ::ftruncate(file_, before.st_size);
  }

  void fail(int error) {
    if (failure_ == 0) failure_ = error;
  }

  const SharedBlock& block_;
  const int file_, session_;
  std::uint32_t written_;
  pthread_t thread_{};
  bool begun_ = false;
  std::atomic<bool> ending_{false};
  std::atomic<int> failure_{0};
};

class Supervision {
 public:
  Supervision(SharedBlock& block, int halt_files, bool kill_frozen)
      : block_(block), halt_files_(halt_files), kill_frozen_(kill_frozen) {}

  // false: the session is over
  bool check_heartbeat() {
    pollfd session{kSessionFile, POLLIN, 0};
    const bool removed = ::ppoll(&session, 1, &kPollInterval, nullptr) > 0;
    const std::int64_t now_ns = monotonic_ns();
    if (block_.ended.load(std::memory_order_acquire)) return false;
    if (removed) {
      // if a halt pipe is full, closing it signals the halt: no writer is left
      publish_halt(Heartbeat::kPermanentHalt);
      note(SupervisorEvent::Kind::kDeath, now_ns, monotonic_ns());
      return false;
    }
    if (halt_files_ > 0) check_heartbeat(now_ns);
    if (kill_frozen_) check_frozen(now_ns);
    return true;
  }

 private:
  // writes a halt to every file that has not received it
  void publish_halt(std::uint64_t halt) {
    for (int n = 0; n < halt_files_; ++n) {
      std::uint64_t& last_written = last_halt_written_[static_cast<std::size_t>(n)];
      if (last_written != halt && ::write(kFirstHaltFile + n, &halt, sizeof halt) == sizeof halt)
        last_written = halt;
    }
  }

  void note(SupervisorEvent::Kind kind, std::int64_t observed_ns, std::int64_t halted_ns) {
    block_.add({kind, block_.heartbeat.beat_ns.load(), observed_ns, halted_ns});
  }

  void check_heartbeat(std::int64_t now_ns) {
    Heartbeat& heartbeat = block_.heartbeat;
    const std::int64_t beat_ns = heartbeat.beat_ns.load(std::memory_order_acquire);
    const bool stalled = beat_ns != Heartbeat::kResting && now_ns - beat_ns > kSupervisedStall_ns;
    const std::uint64_t halts = heartbeat.newest_halt.load();
    const bool halted = halts != heartbeat.newest_ended_halt.load();
    // repeated if a file was full, or another supervisor died before writing
    if (halted) publish_halt(halts);
    if (!stalled || halted) return;
    // counted before it is written: the loop knows of every halt that a device has received, and can end it
    heartbeat.newest_halt.store(halts + 1);
    publish_halt(halts + 1);
    note(SupervisorEvent::Kind::kStall, now_ns, monotonic_ns());
  }

  void check_frozen(std::int64_t now_ns) {
    const std::int64_t passed_ns = last_check_ns_ == 0 ? 0 : now_ns - last_check_ns_;
    last_check_ns_ = now_ns;
    const std::int64_t observed_ns =
        std::max(block_.heartbeat.beat_ns.load(), block_.heartbeat.checked_ns.load());
    const bool lives = observed_ns == Heartbeat::kResting || observed_ns != last_observed_ns_;
    last_observed_ns_ = observed_ns;
    unchanged_ns_ = lives ? 0 : unchanged_ns_ + std::min(passed_ns, kMaxPerCheck_ns);
    if (unchanged_ns_ < kFrozen_ns) return;
    ::syscall(SYS_pidfd_send_signal, kSessionFile, SIGKILL, nullptr, 0);
    note(SupervisorEvent::Kind::kKilled, now_ns, monotonic_ns());
    unchanged_ns_ = 0;
  }

  SharedBlock& block_;
  const int halt_files_;
  const bool kill_frozen_;
  std::array<std::uint64_t, kMaxHaltFiles> last_halt_written_{};  // last halt written to each file
  std::int64_t last_check_ns_ = 0, last_observed_ns_ = 0, unchanged_ns_ = 0;
};

SharedBlock* shared_block() {
  struct stat status {};
  if (::fstat(kBlockFile, &status) != 0 || status.st_size != static_cast<off_t>(sizeof(SharedBlock)))
    return nullptr;
  void* memory =
      ::mmap(nullptr, sizeof(SharedBlock), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, kBlockFile, 0);
  if (memory == MAP_FAILED) return nullptr;
  auto* block = static_cast<SharedBlock*>(memory);
  return block->magic == SharedBlock::kMagic ? block : nullptr;
}

// numbers appended by Supervisor::start(): halt files, whether to kill, whether to record, whether to be
// real-time, the session's process
std::optional<std::array<int, 5>> parse_arguments(const std::vector<std::string>& arguments) {
  std::array<int, 5> numbers{};
  if (arguments.size() != numbers.size()) return std::nullopt;
  for (std::size_t n = 0; n < numbers.size(); ++n) {
    const std::string& text = arguments[n];
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), numbers[n]);
    if (error != std::errc() || end != text.data() + text.size() || numbers[n] < 0) return std::nullopt;
  }
  if (numbers[0] > static_cast<int>(kMaxHaltFiles)) return std::nullopt;
  return numbers;
}

}  // namespace

int supervise(const std::vector<std::string>& arguments) {
  const auto numbers = parse_arguments(arguments);
  SharedBlock* block = numbers ? shared_block() : nullptr;
  if (block == nullptr) {
    std::fprintf(stderr, "palpate: error: supervise is started only by palpate explore\n");
    return 2;
  }
  const auto [halt_files, kill_frozen, record, realtime, session] = *numbers;
  // a full or broken halt pipe must neither block nor terminate this process
  ::signal(SIGPIPE, SIG_IGN);
  for (int n = 0; n < halt_files; ++n)
    ::fcntl(kFirstHaltFile + n, F_SETFL, ::fcntl(kFirstHaltFile + n, F_GETFL) | O_NONBLOCK);
  EventLogWriter writer(*block, kFirstHaltFile + halt_files, session);
  if (record != 0) writer.begin();
  // also blocks termination signals: this process exits when the session has ended
  const RealtimeGrant grant = make_this_thread_realtime({.fifo = realtime != 0,
                                                         .priority = kPriority,
                                                         .lock_memory = realtime != 0,
                                                         .cpu = -1,
                                                         .priorities_above = 0,
                                                         .name = "palpate-super"});
  std::strncpy(block->scheduler.data(), grant.scheduler.c_str(), block->scheduler.size() - 1);
  block->watching.store(true, std::memory_order_release);

  Supervision supervision(*block, halt_files, kill_frozen != 0);
  while (supervision.check_heartbeat()) {
  }
  // closing the halt files signals devices that could not be written to, before waiting for a slow disk
  if (!block->ended.load())
    for (int n = 0; n < halt_files; ++n) ::close(kFirstHaltFile + n);
  if (const int failure = record != 0 ? writer.end() : 0; failure != 0)
    std::fprintf(stderr, "palpate: warning: the supervisor's log of process %d lacks events: %s\n", session,
                 std::strerror(failure));
  if (block->ended.load()) return 0;
  // a simulated device inside the session's process needs no report
  if (halt_files == 0 && kill_frozen == 0) return 0;
  // a dying process is often frozen before the kernel reports its death
  const auto events = block->all();
  const auto first = std::ranges::find(events, events.back().last_beat_ns, &SupervisorEvent::last_beat_ns);
  std::fprintf(stderr, "palpate: the session's process died; %s %.1f ms after the last tick\n",
               halt_files > 0 ? "its devices were commanded to give no force"
                              : "its devices had already been released",
               static_cast<double>(first->halted_ns - first->last_beat_ns) * 1e-6);
  return 0;
}

}  // namespace palpate
