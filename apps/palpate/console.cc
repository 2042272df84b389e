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

#include "keys.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/base/progress_lines.h"
#include "streams.h"
#include "text.h"
#include "verb.h"

namespace palpate::app {
namespace {

std::atomic<bool> stop_requested{false}, stop_heard{false};
sem_t stop_posted;

extern "C" void request_stop(int signal) {
  // a second one ends the program at once, the usual way
  if (!stop_requested.exchange(true)) {
    ::sem_post(&stop_posted);
    return;
  }
  Keys::restore();
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

// Ends the program where the work does not look whether it shall stop: it waits for a file system or a name
// server, or is in a library's long loop. What has heard of the stop ends in its own time, so that nothing is
// half written.
void end_what_does_not_hear() {
  while (::sem_wait(&stop_posted) != 0) {
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(800));
  if (stop_heard) return;
  abandon_outputs();
  Keys::restore();
  constexpr std::string_view kWords = "palpate: error: interrupted\n";
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, kWords.data(), kWords.size());
  ::_exit(kExitInterrupted);
}

// what a line on the terminal may take; the last column stays free, so that the cursor does not wrap
std::size_t terminal_columns() {
  winsize size{};
  const bool known = ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1;
  return known ? size.ws_col - 1u : 79;
}

// one line on a terminal, redrawn at most 20 times a second and erased when a stage is done
class Bar {
 public:
  ~Bar() { clear(); }
  void show(std::string_view stage, double fraction) {
    const std::lock_guard lock(mutex_);
    const auto now = std::chrono::steady_clock::now();
    if (fraction < 1 && stage == stage_ && now - drawn_ < std::chrono::milliseconds(50)) return;
    stage_ = stage;
    drawn_ = now;
    constexpr int kWidth = 30;
    const int filled = static_cast<int>(kWidth * std::min(1.0, std::max(0.0, fraction)));
    std::fprintf(terminal(), "\r\033[K%s [%s%s] %3d %%", fitted(printable_name(stage_), 34).c_str(),
                 std::string(filled, '#').c_str(), std::string(kWidth - filled, ' ').c_str(),
                 static_cast<int>(100 * fraction));
    shown_ = true;
    if (fraction >= 1) erase();
    std::fflush(terminal());
  }
  void show(const std::string& line) {
    const std::lock_guard lock(mutex_);
    // a terminal that is held (Ctrl-S) must not hold what the line tells of
    pollfd screen{STDERR_FILENO, POLLOUT, 0};
    if (::poll(&screen, 1, 0) != 1) return;
    const std::string shown = printable_name(line);
    std::fprintf(terminal(), "\r\033[K%s",
                 fitted(shown, std::min(columns_of(shown), terminal_columns())).c_str());
    shown_ = true;
    std::fflush(terminal());
  }
  void clear() {
    const std::lock_guard lock(mutex_);
    erase();
  }

 private:
  void erase() {
    if (shown_) std::fputs("\r\033[K", terminal());
    shown_ = false;
  }
  std::mutex mutex_;
  std::string stage_;
  std::chrono::steady_clock::time_point drawn_{};
  bool shown_ = false;
};

Bar& bar() {
  static Bar the_bar;
  return the_bar;
}

// where stderr is no terminal: a line now and then
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

Lines& lines() {
  static Lines the_lines;
  return the_lines;
}

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

Console::Console() {
  ::sem_init(&stop_posted, 0, 0);
  std::thread(end_what_does_not_hear).detach();
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, request_stop);
}

Progress Console::progress() {
  Progress::Show show;
  if (quiet) return {show, &stop_requested, &stop_heard};
  if (::isatty(STDERR_FILENO))
    show = [](std::string_view stage, double fraction) { bar().show(stage, fraction); };
  else
    show = [](std::string_view stage, double fraction) { lines().show(stage, fraction); };
  return {show, &stop_requested, &stop_heard};
}

std::size_t Console::columns() const {
  return terminal_columns();
}

void Console::live(const std::string& line) {
  if (quiet || !::isatty(STDERR_FILENO)) return;
  if (line.empty())
    bar().clear();
  else
    bar().show(line);
}

Warn Console::warn() {
  return [](const std::string& message) {
    bar().clear();
    std::fprintf(stderr, "palpate: warning: %s\n", message.c_str());
  };
}

void Console::note(const std::string& text) {
  if (quiet) return;
  bar().clear();
  std::fprintf(stderr, "%s\n", text.c_str());
}

int Console::fail(const Error& error) {
  bar().clear();
  // a line end in a name would let it write a line of its own
  const Error shown{error.kind, printable_name(error.what), printable_name(error.where), error.remedy};
  std::fprintf(stderr, "palpate: error: %s\n", shown.message().c_str());
  return exit_code(error.kind);
}

}  // namespace palpate::app
