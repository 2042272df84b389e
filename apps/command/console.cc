#include <poll.h>
#include <semaphore.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>

#include "console.h"
#include "keys.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/base/progress_lines.h"
#include "signals.h"
#include "text.h"

namespace palpate::app {
namespace {

// state of the current run; global because a signal handler accesses it
std::atomic<bool> stop_requested{false}, stop_acknowledged{false};
sem_t wake_up;  // posted when a stop is requested, and when the run ends

extern "C" void request_stop(int signal) {
  // a second signal has its default effect and ends the program
  if (!stop_requested.exchange(true)) {
    ::sem_post(&wake_up);
    return;
  }
  Keys::restore();
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

}  // namespace

namespace detail {

/// Ends the process if the work does not react to a stop request, because it waits for a file system or a
/// name server, or is in a long loop of a library. Work that has reacted may finish, so that no output is
/// left half-written.
class StopWatch {
 public:
  explicit StopWatch(int err) {
    stop_requested = stop_acknowledged = false;
    ::sem_init(&wake_up, 0, 0);
    thread_ = std::thread([this, err] { watch(err); });
  }
  ~StopWatch() {
    run_ended_ = true;
    ::sem_post(&wake_up);
    thread_.join();
    ::sem_destroy(&wake_up);
  }
  StopWatch(const StopWatch&) = delete;
  StopWatch& operator=(const StopWatch&) = delete;

 private:
  void watch(int err) {
    while (::sem_wait(&wake_up) != 0) {
    }
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(800);
    while (std::chrono::steady_clock::now() < deadline) {
      if (run_ended_ || stop_acknowledged) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    abandon_outputs();
    Keys::restore();
    constexpr std::string_view kWords = "palpate: error: interrupted\n";
    [[maybe_unused]] const ssize_t written = ::write(err, kWords.data(), kWords.size());
    ::_exit(kExitInterrupted);
  }

  std::atomic<bool> run_ended_{false};
  std::thread thread_;
};

// width of a line; the last column is left free so that the cursor does not wrap
static std::size_t terminal_columns(int terminal) {
  winsize size{};
  const bool known = ::ioctl(terminal, TIOCGWINSZ, &size) == 0 && size.ws_col > 1;
  return known ? size.ws_col - 1u : 79;
}

// progress bar on a terminal, redrawn at most 20 times a second and erased when a stage is complete
class Bar {
 public:
  explicit Bar(int terminal) : terminal_(terminal) {}
  ~Bar() { clear(); }
  void show(std::string_view stage, double fraction) {
    const std::lock_guard lock(mutex_);
    const auto now = std::chrono::steady_clock::now();
    if (fraction < 1 && stage == stage_ && now - drawn_ < std::chrono::milliseconds(50)) return;
    stage_ = stage;
    drawn_ = now;
    constexpr int kWidth = 30;
    const int filled = static_cast<int>(kWidth * std::min(1.0, std::max(0.0, fraction)));
    ::dprintf(terminal_, "\r\033[K%s [%s%s] %3d %%", pad_or_truncate(printable_name(stage_), 34).c_str(),
              std::string(filled, '#').c_str(), std::string(kWidth - filled, ' ').c_str(),
              static_cast<int>(100 * fraction));
    shown_ = true;
    if (fraction >= 1) erase();
  }
  void show(const std::string& line) {
    const std::lock_guard lock(mutex_);
    // a terminal paused with Ctrl-S must not block the caller
    pollfd screen{terminal_, POLLOUT, 0};
    if (::poll(&screen, 1, 0) != 1) return;
    const std::string shown = printable_name(line);
    ::dprintf(terminal_, "\r\033[K%s",
              pad_or_truncate(shown, std::min(display_width(shown), terminal_columns(terminal_))).c_str());
    shown_ = true;
  }
  void clear() {
    const std::lock_guard lock(mutex_);
    erase();
  }

 private:
  void erase() {
    if (shown_) ::dprintf(terminal_, "\r\033[K");
    shown_ = false;
  }
  const int terminal_;
  std::mutex mutex_;
  std::string stage_;
  std::chrono::steady_clock::time_point drawn_{};
  bool shown_ = false;
};

// progress as occasional lines, if stderr is not a terminal
class Lines {
 public:
  void show(std::string_view stage, double fraction) {
    const std::lock_guard lock(mutex_);
    if (const auto line = lines_.line(stage, fraction, std::chrono::steady_clock::now()))
      std::fprintf(stderr, "%s\n", line->c_str());
  }

 private:
  std::mutex mutex_;
  ProgressLines lines_{std::chrono::steady_clock::now()};
};

}  // namespace detail

namespace {

int exit_code(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kBadInput:
      return kExitBadInput;
    case ErrorKind::kUsage:
      return kExitUsage;
    case ErrorKind::kOutput:
      return kExitOutput;
    case ErrorKind::kUnavailable:
      return kExitUnavailable;
    case ErrorKind::kInterrupted:
      return kExitInterrupted;
  }
  return kExitBadInput;
}

}  // namespace

struct Console::State {
  explicit State(const Streams& to) : streams(to), bar(to.err), watch(to.err) {}

  Streams streams;
  detail::Bar bar;  // used if stderr is a terminal
  detail::Lines lines;
  detail::StopWatch watch;
  ScopedSignals signals{{SIGINT, SIGTERM, SIGHUP}, request_stop};
};

Console::Console(const Streams& streams) : state_(std::make_unique<State>(streams)) {}

Console::~Console() = default;

const Streams& Console::streams() const {
  return state_->streams;
}

Progress Console::progress() {
  Progress::Show show;
  if (quiet) return {show, &stop_requested, &stop_acknowledged};
  if (::isatty(state_->streams.err))
    show = [&bar = state_->bar](std::string_view stage, double fraction) { bar.show(stage, fraction); };
  else
    show = [&lines = state_->lines](std::string_view stage, double fraction) { lines.show(stage, fraction); };
  return {show, &stop_requested, &stop_acknowledged};
}

std::size_t Console::columns() const {
  return detail::terminal_columns(state_->streams.err);
}

void Console::show_status(const std::string& line) {
  if (quiet || !::isatty(state_->streams.err)) return;
  if (line.empty())
    state_->bar.clear();
  else
    state_->bar.show(line);
}

Warn Console::warn() {
  return [&bar = state_->bar](const std::string& message) {
    bar.clear();
    std::fprintf(stderr, "palpate: warning: %s\n", message.c_str());
  };
}

void Console::note(const std::string& text) {
  if (quiet) return;
  state_->bar.clear();
  std::fprintf(stderr, "%s\n", text.c_str());
}

int Console::fail(const Error& error) {
  state_->bar.clear();
  // line breaks in a name could forge a line of output
  const Error shown{error.kind, printable_name(error.what), printable_name(error.where), error.remedy};
  std::fprintf(stderr, "palpate: error: %s\n", shown.message().c_str());
  return exit_code(error.kind);
}

}  // namespace palpate::app
