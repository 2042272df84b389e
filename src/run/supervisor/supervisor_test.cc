#include "palpate/supervisor/supervisor.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <spawn.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <optional>
#include <random>
#include <sstream>
#include <thread>
#include <utility>

#include "base/test_child.h"
#include "base/test_folder.h"
#include "base/test_limits.h"
#include "base/test_seed.h"
#include "base/test_wait.h"
#include "palpate/recording/recording_source.h"
#include "palpate/servo/realtime.h"
#include "supervisor/test_device.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;
using testing::TestDeviceMemory;

double ms(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-6;
}

// 0 if it was earlier
double ms_from(std::int64_t then_ns, std::int64_t later_ns) {
  return ms(std::max<std::int64_t>(0, later_ns - then_ns));
}

/// A supervised session that presses, in a process of its own, and its device in another.
class Pressing {
 public:
  /// @param recording  empty: no recording
  explicit Pressing(bool device_elsewhere = true, bool kill_frozen = false,
                    const std::filesystem::path& recording = {}) {
    memory_file_ = ::memfd_create("test device", 0);
    PALPATE_CHECK(::ftruncate(memory_file_, sizeof(TestDeviceMemory)) == 0);
    void* room =
        ::mmap(nullptr, sizeof(TestDeviceMemory), PROT_READ | PROT_WRITE, MAP_SHARED, memory_file_, 0);
    PALPATE_CHECK(room != MAP_FAILED);
    device_ = new (room) TestDeviceMemory;
    int halt[2], orders[2], declared[2], record[2];
    for (int* pipe : {halt, orders, declared, record}) PALPATE_CHECK(::pipe2(pipe, O_CLOEXEC) == 0);
    orders_ = orders[1];
    declared_ = declared[0];
    record_ = record[0];
    record_in_ = record[1];

    device_process_ = ::fork();
    if (device_process_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      // close the other ends, so that a reader is not kept waiting by writers that do not exist
      for (const int file : {halt[1], orders[0], orders[1], declared[0], declared[1], record[0], record[1]})
        ::close(file);
      testing::be_test_device(*device_, halt[0]);
    }
    session_ = ::fork();
    if (session_ == 0) {
      ::dup2(orders[0], STDIN_FILENO);
      ::dup2(declared[1], STDOUT_FILENO);
      // a test running in the background ignores some signals
      for (int signal = 1; signal < SIGRTMIN; ++signal) ::signal(signal, SIG_DFL);
      const rlimit none{0, 0};
      ::setrlimit(RLIMIT_CORE, &none);
      // leak detection at exit stops all threads and resumes them before the process ends
      const char* options = std::getenv("ASAN_OPTIONS");
      ::setenv("ASAN_OPTIONS", (std::string(options != nullptr ? options : "") + ":detect_leaks=0").c_str(),
               1);
      for (const int file : {halt[1], record[1]}) ::fcntl(file, F_SETFD, 0);
      const std::string memory = std::to_string(memory_file_),
                        halt_fd = std::to_string(device_elsewhere ? halt[1] : -1),
                        records = std::to_string(record[1]);
      ::execl(PALPATE_SUPERVISED_SESSION, PALPATE_SUPERVISED_SESSION, memory.c_str(), halt_fd.c_str(),
              records.c_str(), kill_frozen ? "1" : "0", recording.c_str(), nullptr);
      ::_exit(127);
    }
    halts_ = halt[0];
    for (const int file : {halt[1], orders[0], declared[1]}) ::close(file);
  }
  ~Pressing() {
    for (const pid_t process : {session_, device_process_}) {
      ::kill(process, SIGKILL);
      ::waitpid(process, nullptr, 0);
    }
    for (const int file : {orders_, declared_, record_, record_in_, memory_file_, halts_})
      if (file >= 0) ::close(file);
    ::munmap(device_, sizeof *device_);
  }
  Pressing(const Pressing&) = delete;
  Pressing& operator=(const Pressing&) = delete;

  /// Waits until the force is fully on; false: the process died.
  bool presses() const {
    char byte = 0;
    return ::read(declared_, &byte, 1) == 1;
  }
  void order(char letter) const { PALPATE_CHECK(::write(orders_, &letter, 1) == 1); }
  void signal(int signal) const { ::kill(session_, signal); }

  /// Time since which the device has been at rest after `then_ns`, possibly earlier; 0: it acts for ten
  /// seconds.
  std::int64_t rest_after(std::int64_t then_ns) const {
    std::int64_t since_ns = 0;
    // a short pause does not count as rest
    const bool rests = testing::soon([&] {
      since_ns = device_->at_rest_since();
      return since_ns != 0 && monotonic_ns() > std::max(since_ns, then_ns) + 20'000'000;
    });
    return rests ? since_ns : 0;
  }
  bool acts_again() const {
    return testing::soon([&] { return device_->acting_N > 0; });
  }

  /// Blocks the record file until record() is called.
  void fill_record() const {
    ::fcntl(record_in_, F_SETFL, O_NONBLOCK);
    while (::write(record_in_, "\n", 1) == 1) {
    }
    ::fcntl(record_in_, F_SETFL, 0);
  }

  /// Events in the supervisor's record, in order; waits for its end.
  std::vector<std::string> record() const {
    ::close(std::exchange(record_in_, -1));
    std::string text;
    std::array<char, 256> part{};
    for (ssize_t received = 0; (received = ::read(record_, part.data(), part.size())) > 0;)
      text.append(part.data(), static_cast<std::size_t>(received));
    std::vector<std::string> lines;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);)
      if (!line.empty()) lines.push_back(line);
    return lines;
  }
  /// Number of unread halts in the halt pipe.
  int unread_halts() const {
    int bytes = 0;
    PALPATE_CHECK(::ioctl(halts_, FIONREAD, &bytes) == 0);
    return bytes / 8;
  }
  /// Stops the session until a halt resulted; false: none did.
  bool stops_and_is_halted() const {
    for (int tries = 0; tries < 20; ++tries) {
      const int before = unread_halts();
      signal(SIGSTOP);
      for (int n = 0; n < 1000 && unread_halts() == before; ++n) std::this_thread::sleep_for(1ms);
      if (unread_halts() > before) return true;
      // it had been halted just before, as happens to a process waiting long for a CPU
      signal(SIGCONT);
      std::this_thread::sleep_for(100ms);
    }
    return false;
  }
  /// Fills the halt pipe with numbers that halt nothing, until the device reads them.
  void fill_halt_file() const {
    const int file = ::open(("/proc/self/fd/" + std::to_string(halts_)).c_str(), O_WRONLY | O_NONBLOCK);
    constexpr std::uint64_t kNone = 0;
    while (::write(file, &kNone, sizeof kNone) == sizeof kNone) {
    }
    PALPATE_CHECK(file >= 0 && errno == EAGAIN);
    ::close(file);
  }
  pid_t session() const { return session_; }
  pid_t device_process() const { return device_process_; }
  const TestDeviceMemory& device() const { return *device_; }

 private:
  int memory_file_ = -1, orders_ = -1, declared_ = -1, record_ = -1, halts_ = -1;
  mutable int record_in_ = -1;  // kept open until record() waits for the end of all writers
  TestDeviceMemory* device_ = nullptr;
  pid_t device_process_ = -1, session_ = -1;
};

std::int64_t number_in(const std::string& line, const std::string& field) {
  const auto at = line.find("\"" + field + "\": ");
  return at == std::string::npos ? -1 : std::stoll(line.substr(at + field.size() + 4));
}

/// Measures the scheduling latency of idle threads, one bound to each CPU, as a reference for time limits.
class BareThreads {
 public:
  /// @param priority  SCHED_FIFO priority, if permitted
  explicit BareThreads(int priority) {
    cpu_set_t set;
    PALPATE_CHECK(::sched_getaffinity(0, sizeof set, &set) == 0);
    for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
      if (!CPU_ISSET(static_cast<unsigned>(cpu), &set)) continue;
      std::atomic<std::int64_t>& requested_ns = requested_ns_.emplace_back(monotonic_ns());
      threads_.emplace_back([this, priority, cpu, &requested_ns] {
        make_this_thread_realtime({.fifo = true,
                                   .priority = priority,
                                   .lock_memory = false,
                                   .cpu = cpu,
                                   .priorities_above = 0,
                                   .name = "bare"});
        look(requested_ns);
      });
    }
  }
  ~BareThreads() {
    end_ = true;
    for (std::thread& thread : threads_) thread.join();
  }
  BareThreads(const BareThreads&) = delete;
  BareThreads& operator=(const BareThreads&) = delete;

  /// Maximum latency so far, including threads that are still waiting for a CPU.
  double latest_ms() {
    for (const auto& requested_ns : requested_ns_) count(monotonic_ns() - requested_ns);
    return ms(latest_ns_);
  }

 private:
  static constexpr std::int64_t kSleep_ns = 1'000'000;

  void look(std::atomic<std::int64_t>& requested_ns) {
    while (!end_) {
      requested_ns = monotonic_ns();
      std::this_thread::sleep_for(std::chrono::nanoseconds(kSleep_ns));
      count(monotonic_ns() - requested_ns);
    }
  }
  void count(std::int64_t slept_ns) {
    const std::int64_t late_ns = slept_ns - kSleep_ns;
    for (std::int64_t latest_ns = latest_ns_; late_ns > latest_ns;)
      if (latest_ns_.compare_exchange_weak(latest_ns, late_ns)) break;
  }

  std::atomic<bool> end_{false};
  std::atomic<std::int64_t> latest_ns_{0};
  std::deque<std::atomic<std::int64_t>> requested_ns_;  // per thread
  std::vector<std::thread> threads_;
};

// as requested in supervise.cc
constexpr int kSupervisorPriority = 95;
// limit from the last tick to a device without force, plus the latency of an idle thread
// (docs/results/deaths.md)
constexpr double kPromise_ms = 10;

struct End {
  const char* name;
  int signal;  // 0: use `order`
  char order;
};
constexpr End kEnds[] = {{"SIGKILL", SIGKILL, 0},
                         {"SIGTERM", SIGTERM, 0},
                         {"SIGINT", SIGINT, 0},
                         {"SIGQUIT", SIGQUIT, 0},
                         {"SIGSEGV", SIGSEGV, 0},
                         {"SIGBUS", SIGBUS, 0},
                         {"SIGFPE", SIGFPE, 0},
                         {"SIGILL", SIGILL, 0},
                         {"SIGABRT", SIGABRT, 0},
                         {"SIGSYS", SIGSYS, 0},
                         {"SIGTRAP", SIGTRAP, 0},
                         {"SIGXCPU", SIGXCPU, 0},
                         {"SIGXFSZ", SIGXFSZ, 0},
                         {"SIGALRM", SIGALRM, 0},
                         {"SIGPROF", SIGPROF, 0},
                         {"SIGVTALRM", SIGVTALRM, 0},
                         {"SIGUSR1", SIGUSR1, 0},
                         {"SIGUSR2", SIGUSR2, 0},
                         {"SIGHUP", SIGHUP, 0},
                         {"SIGPIPE", SIGPIPE, 0},
                         {"SIGIO", SIGIO, 0},
                         {"SIGPWR", SIGPWR, 0},
                         {"SIGSTKFLT", SIGSTKFLT, 0},
                         {"abort", 0, 'a'},
                         {"terminate", 0, 't'},
                         {"exception", 0, 'x'},
                         {"a thread's SIGSEGV", 0, 's'},
                         {"an exception in the servo's thread", 0, 'v'},
                         {"an exception in the watchdog's thread", 0, 'w'},
                         {"an exception in the recorder's thread", 0, 'r'},
                         {"_exit", 0, '_'},
                         {"exit", 0, 'e'}};

// one trial each by default, twenty with PALPATE_TEST_DEATHS=all, the full campaign
int trials() {
  const char* value = std::getenv("PALPATE_TEST_DEATHS");
  return value != nullptr && std::string(value) == "all" ? 20 : 1;
}

void print(const char* what, std::vector<double> figures_ms) {
  std::ranges::sort(figures_ms);
  const auto at = [&](double part) {
    return figures_ms[static_cast<std::size_t>(part * static_cast<double>(figures_ms.size() - 1))];
  };
  std::printf("%s, %zu trials, ms: %.2f (p50), %.2f (p99), %.2f (largest)\n", what, figures_ms.size(),
              at(0.5), at(0.99), at(1));
}

// a random time within the recorder's second between two flushes
std::chrono::microseconds some_time(std::mt19937_64& random) {
  return std::chrono::microseconds(random() % 1'000'000);
}

/// Number of ticks in a recording being written; retries if the read coincides with a flush.
std::uint64_t ticks_in(const std::filesystem::path& recording) {
  std::uint64_t ticks = 0;
  std::string complaint;
  EXPECT_TRUE(testing::soon([&] {
    const auto source = RecordingSource::open(recording);
    if (source.ok())
      ticks = source->head().ticks;
    else
      complaint = source.error().message();
    return source.ok();
  })) << complaint;
  return ticks;
}

/// The recording opens and is complete up to its last flush, without gaps.
/// @param flushed  ticks flushed earlier
void expect_reopens(const std::filesystem::path& recording, std::uint64_t flushed, bool whole = false) {
  const auto source = RecordingSource::open(recording);
  ASSERT_TRUE(source.ok()) << source.error().message();
  EXPECT_EQ(source->head().summary.has_value(), whole);
  std::uint64_t ticks = 0, misplaced = 0;
  const auto read = source->read([&](const RecordingPart& part) -> Result<void> {
    for (const TickRecord& tick : part.ticks) misplaced += tick.tick != ticks++;
    return {};
  });
  EXPECT_TRUE(read.ok()) << read.error().message();
  EXPECT_EQ(misplaced, 0u);
  EXPECT_EQ(ticks, source->head().ticks);
  EXPECT_GE(ticks, flushed);
}

TEST(Supervisor, DeviceGetsZeroForceOnEveryDeath) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  const test::TemporaryFolder folder;
  const auto recording = folder / "run.h5";
  std::vector<double> after_ms, since_tick_ms, bare_ms, beyond_ms;
  std::uint64_t flushed_in_all = 0;
  std::size_t late = 0;
  for (const End& end : kEnds) {
    SCOPED_TRACE(end.name);
    for (int n = 0; n < trials(); ++n) {
      const Pressing session(true, false, recording);
      ASSERT_TRUE(session.presses()) << end.name;
      std::this_thread::sleep_for(some_time(random));
      const std::uint64_t flushed = ticks_in(recording);
      flushed_in_all += flushed;
      BareThreads bare(kSupervisorPriority);
      const std::int64_t then_ns = monotonic_ns();
      if (end.signal != 0)
        session.signal(end.signal);
      else
        session.order(end.order);
      const std::int64_t rest_ns = session.rest_after(then_ns);
      ASSERT_NE(rest_ns, 0) << end.name << ": the device still pushes";
      after_ms.push_back(ms_from(then_ns, rest_ns));
      bare_ms.push_back(bare.latest_ms());
      // the supervisor has recorded it, with times
      const auto record = session.record();
      ASSERT_FALSE(record.empty()) << end.name;
      // the force did not return before the process was gone
      EXPECT_EQ(session.rest_after(then_ns), rest_ns) << end.name;
      EXPECT_NE(record.back().find("\"death\""), std::string::npos) << end.name << ": " << record.back();
      EXPECT_GE(number_in(record.back(), "halted_ns"), number_in(record.back(), "observed_ns"));
      EXPECT_GE(number_in(record.back(), "observed_ns"), number_in(record.back(), "last_beat_ns"));
      since_tick_ms.push_back(ms_from(number_in(record.back(), "last_beat_ns"), rest_ns));
      beyond_ms.push_back(since_tick_ms.back() - bare_ms.back());
      if (beyond_ms.back() > kPromise_ms) {
        std::printf(
            "%s: zero %.2f ms after the last tick, bare threads late by %.2f; the supervisor's record:\n",
            end.name, since_tick_ms.back(), bare_ms.back());
        for (const std::string& line : record) std::printf("  %s\n", line.c_str());
      }
      // polling period of a millisecond for both, plus one more thread until the device receives the halt
      late += since_tick_ms.back() > kPromise_ms + 2 * (bare_ms.back() + 1);
      ASSERT_NO_FATAL_FAILURE(expect_reopens(recording, flushed));
    }
  }
  // otherwise the recordings were not tested
  EXPECT_GT(flushed_in_all, 0u);
  // a busy machine may occasionally delay one and not the other
  EXPECT_LE(late, since_tick_ms.size() / 4);
  print("zero after the cause", after_ms);
  print("zero after the last tick", since_tick_ms);
  print("bare threads of the supervisor's priority late by", bare_ms);
  print("zero after the last tick, less that", beyond_ms);
}

TEST(Supervisor, AStandstillGetsZeroAndComesBackByTheRamp) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  const test::TemporaryFolder folder;
  const auto recording = folder / "run.h5";
  const Pressing session(true, false, recording);
  ASSERT_TRUE(session.presses());
  std::vector<std::int64_t> stopped_ns, rested_ns;
  std::vector<double> bare_ms;
  for (int n = 0; n < 2 * trials(); ++n) {
    std::this_thread::sleep_for(some_time(random));
    BareThreads bare(kSupervisorPriority);
    const std::int64_t then_ns = monotonic_ns();
    session.signal(SIGSTOP);
    const std::int64_t rest_ns = session.rest_after(then_ns);
    ASSERT_NE(rest_ns, 0) << "the device still pushes";
    stopped_ns.push_back(then_ns);
    rested_ns.push_back(rest_ns);
    bare_ms.push_back(bare.latest_ms());
    EXPECT_EQ(session.device().acting_N, 0);
    session.signal(SIGCONT);
    EXPECT_TRUE(session.acts_again());
    // the force ramps back to its full value
    session.order('g');
    ASSERT_TRUE(session.presses());
  }
  session.order('q');
  const auto record = session.record();
  for (const std::string& line : record) EXPECT_NE(line.find("\"stall\""), std::string::npos) << line;
  EXPECT_GT(ticks_in(recording), 0u);

  // stopping a process takes effect thread by thread; the others continue to tick meanwhile
  std::vector<double> since_tick_ms, beyond_ms;
  std::size_t late = 0;
  for (std::size_t n = 0; n < bare_ms.size(); ++n) {
    const auto stall = std::ranges::find_if(
        record, [&](const std::string& line) { return number_in(line, "observed_ns") > stopped_ns[n]; });
    // a process that had waited long for a CPU was halted already
    if (stall == record.end() || number_in(*stall, "observed_ns") > rested_ns[n]) continue;
    since_tick_ms.push_back(ms_from(number_in(*stall, "last_beat_ns"), rested_ns[n]));
    beyond_ms.push_back(since_tick_ms.back() - bare_ms[n]);
    late += since_tick_ms.back() > kPromise_ms + 2 * (bare_ms[n] + 1);
  }
  ASSERT_GE(2 * since_tick_ms.size(), bare_ms.size());
  // same tolerance as for deaths
  EXPECT_LE(late, 1 + bare_ms.size() / 4);
  print("stopped: zero after the last tick", since_tick_ms);
  print("bare threads of the supervisor's priority late by", bare_ms);
  print("zero after the last tick, less that", beyond_ms);
}

// session and device are both stopped
void expect_halted_when_it_hears(const Pressing& session) {
  const std::int64_t then_ns = monotonic_ns();
  ::kill(session.device_process(), SIGCONT);
  EXPECT_NE(session.rest_after(then_ns), 0) << "the device pushes through a halt";
  session.signal(SIGCONT);
  EXPECT_TRUE(session.acts_again());
  session.order('q');
}

// Two stalls of which the device learns late and at once: the end of the first does not end the second.
TEST(Supervisor, AStarvedDeviceObeysTheNewestHalt) {
  const Pressing session;
  ASSERT_TRUE(session.presses());
  ::kill(session.device_process(), SIGSTOP);
  for (const bool is_newest : {false, true}) {
    ASSERT_TRUE(session.stops_and_is_halted());
    if (is_newest) break;
    session.signal(SIGCONT);
    // the force is fully on again, so the loop has ended the halt
    session.order('g');
    ASSERT_TRUE(session.presses());
  }
  expect_halted_when_it_hears(session);
}

TEST(Supervisor, FullHaltPipeStillReceivesTheHalt) {
  const Pressing session;
  ASSERT_TRUE(session.presses());
  ::kill(session.device_process(), SIGSTOP);
  session.fill_halt_file();
  session.signal(SIGSTOP);
  // longer than the supervisor needs for detection
  std::this_thread::sleep_for(50ms);
  expect_halted_when_it_hears(session);
}

TEST(Supervisor, AServoThreadThatHangsGetsZero) {
  const Pressing session;
  ASSERT_TRUE(session.presses());
  const std::int64_t then_ns = monotonic_ns();
  session.order('h');
  ASSERT_TRUE(session.presses());
  ASSERT_NE(session.rest_after(then_ns), 0);
  session.order('g');
  ASSERT_TRUE(session.presses());
  EXPECT_TRUE(session.acts_again());
  session.order('q');
}

TEST(Supervisor, AClockThreadFrozenWhereItStandsGetsZeroAndComesBack) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  const test::TemporaryFolder folder;
  const auto recording = folder / "run.h5";
  const Pressing session(true, false, recording);
  ASSERT_TRUE(session.presses());
  std::vector<double> after_ms;
  const auto freeze = [&] {
    std::this_thread::sleep_for(some_time(random));
    const std::int64_t then_ns = monotonic_ns();
    session.order('z');
    ASSERT_TRUE(session.presses());
    const std::int64_t rest_ns = session.rest_after(then_ns);
    ASSERT_NE(rest_ns, 0) << "the device still pushes";
    after_ms.push_back(ms_from(then_ns, rest_ns));
  };
  for (int n = 0; n < trials(); ++n) {
    ASSERT_NO_FATAL_FAILURE(freeze());
    session.order('g');
    ASSERT_TRUE(session.presses());
    EXPECT_TRUE(session.acts_again());
  }
  // and dies in that state
  ASSERT_NO_FATAL_FAILURE(freeze());
  const std::uint64_t flushed = ticks_in(recording);
  session.signal(SIGKILL);
  const auto record = session.record();
  ASSERT_GE(record.size(), after_ms.size() + 1);
  for (std::size_t n = 0; n + 1 < record.size(); ++n)
    EXPECT_NE(record[n].find("\"stall\""), std::string::npos) << record[n];
  EXPECT_NE(record.back().find("\"death\""), std::string::npos) << record.back();
  EXPECT_EQ(session.device().acting_N, 0);
  expect_reopens(recording, flushed);
  print("frozen: zero after the cause", after_ms);
}

// A failing recording or output affects neither the force nor the supervisor.
TEST(Supervisor, AFullDiskAndClosedStreamsLeaveTheForceAsItIs) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  const test::TemporaryFolder folder;
  const auto recording = folder / "run.h5";
  for (const char order : {'f', 'c'}) {
    SCOPED_TRACE(order == 'f' ? "a full disk" : "closed stdout and stderr");
    std::vector<double> since_tick_ms;
    for (int n = 0; n < trials(); ++n) {
      const Pressing session(true, false, recording);
      ASSERT_TRUE(session.presses());
      std::this_thread::sleep_for(some_time(random));
      const std::uint64_t flushed = ticks_in(recording), commands = session.device().commands;
      session.order(order);
      // no output after stdout is closed
      ASSERT_EQ(session.presses(), order == 'f');
      if (order == 'f') std::this_thread::sleep_for(some_time(random) / 10);
      EXPECT_GT(session.device().acting_N, 0);
      EXPECT_TRUE(testing::soon([&] { return session.device().commands > commands; }));

      const std::int64_t then_ns = monotonic_ns();
      session.signal(SIGKILL);
      const std::int64_t rest_ns = session.rest_after(then_ns);
      ASSERT_NE(rest_ns, 0) << "the device still pushes";
      const auto record = session.record();
      ASSERT_FALSE(record.empty());
      EXPECT_NE(record.back().find("\"death\""), std::string::npos) << record.back();
      since_tick_ms.push_back(ms_from(number_in(record.back(), "last_beat_ns"), rest_ns));
      ASSERT_NO_FATAL_FAILURE(expect_reopens(recording, flushed));
    }
    print(order == 'f' ? "after a full disk, zero after the last tick"
                       : "after closed streams, zero after the last tick",
          since_tick_ms);
  }
}

TEST(Supervisor, OrderlyExitIsNotLogged) {
  const test::TemporaryFolder folder;
  const auto recording = folder / "run.h5";
  const Pressing session(true, false, recording);
  ASSERT_TRUE(session.presses());
  session.order('q');
  // a stall of the machine may be recorded as such
  for (const std::string& line : session.record())
    EXPECT_NE(line.find("\"stall\""), std::string::npos) << line;
  int status = 0;
  ASSERT_EQ(::waitpid(session.session(), &status, 0), session.session());
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  EXPECT_EQ(session.device().acting_N, 0);
  expect_reopens(recording, 1, true);
}

TEST(Supervisor, EndsAProcessThatStandsStillWithItsDeviceInIt) {
  const Pressing session(false, true);
  ASSERT_TRUE(session.presses());
  session.signal(SIGSTOP);
  int status = 0;
  // a briefly stopped process continues; one stopped for good is killed
  ASSERT_EQ(::waitpid(session.session(), &status, 0), session.session());
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
  const auto record = session.record();
  ASSERT_EQ(record.size(), 2u);
  EXPECT_NE(record[0].find("\"killed\""), std::string::npos);
  EXPECT_NE(record[1].find("\"death\""), std::string::npos);
}

TEST(Supervisor, StalledSessionWithoutADeviceInItsProcessIsNotKilled) {
  const Pressing session(false, false);
  ASSERT_TRUE(session.presses());
  session.signal(SIGSTOP);
  std::this_thread::sleep_for(1s);
  session.signal(SIGCONT);
  session.order('g');
  EXPECT_TRUE(session.presses());
  session.order('q');
}

// the child process of a session that is its supervisor
pid_t supervisor_of(pid_t session) {
  const std::string path =
      "/proc/" + std::to_string(session) + "/task/" + std::to_string(session) + "/children";
  std::FILE* file = std::fopen(path.c_str(), "r");
  int child = 0;
  if (file == nullptr || std::fscanf(file, "%d", &child) != 1) child = 0;
  if (file != nullptr) std::fclose(file);
  return child;
}

TEST(Supervisor, DeviceRestsWhenSessionAndSupervisorAreKilled) {
  const Pressing session;
  ASSERT_TRUE(session.presses());
  const pid_t supervisor = supervisor_of(session.session());
  ASSERT_GT(supervisor, 0);
  const std::int64_t then_ns = monotonic_ns();
  ::kill(supervisor, SIGKILL);
  session.signal(SIGKILL);
  EXPECT_NE(session.rest_after(then_ns), 0);
}

TEST(Supervisor, KeysAndSignalsThatEndProgramsDoNotEndIt) {
  const Pressing session;
  ASSERT_TRUE(session.presses());
  const pid_t supervisor = supervisor_of(session.session());
  ASSERT_GT(supervisor, 0);
  EXPECT_NE(::getsid(supervisor), ::getsid(session.session()));
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE, SIGALRM, SIGUSR1})
    ::kill(supervisor, signal);
  std::this_thread::sleep_for(50ms);
  EXPECT_EQ(::kill(supervisor, 0), 0);
  const std::int64_t then_ns = monotonic_ns();
  session.signal(SIGKILL);
  EXPECT_NE(session.rest_after(then_ns), 0);
  const auto record = session.record();
  ASSERT_FALSE(record.empty());
  EXPECT_NE(record.back().find("\"death\""), std::string::npos);
}

TEST(Supervisor, ReportsItsDeathAndRestarts) {
  auto supervisor = Supervisor::start({.command = {PALPATE_SUPERVISED_SESSION, "supervise"}, .halt_fds = {}});
  ASSERT_TRUE(supervisor.ok()) << supervisor.error().message();
  EXPECT_TRUE((*supervisor)->is_running());
  EXPECT_FALSE((*supervisor)->scheduler().empty());
  ::kill(supervisor_of(::getpid()), SIGKILL);
  EXPECT_TRUE(testing::soon([&] { return !(*supervisor)->is_running(); }));
  const auto again = (*supervisor)->restart();
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE((*supervisor)->is_running());
}

// A supervisor may die between counting a halt and writing it.
TEST(Supervisor, ReplacementReportsAnOngoingHalt) {
  int halt[2];
  ASSERT_EQ(::pipe2(halt, O_CLOEXEC), 0);
  auto supervisor =
      Supervisor::start({.command = {PALPATE_SUPERVISED_SESSION, "supervise"}, .halt_fds = {halt[1]}});
  ASSERT_TRUE(supervisor.ok()) << supervisor.error().message();
  const auto reported = [&] {
    std::uint64_t number = 0;
    EXPECT_EQ(::read(halt[0], &number, sizeof number), static_cast<ssize_t>(sizeof number));
    return number;
  };
  (*supervisor)->heartbeat().newest_halt = 7;
  EXPECT_EQ(reported(), 7u);
  ::kill(supervisor_of(::getpid()), SIGKILL);
  ASSERT_TRUE(testing::soon([&] { return !(*supervisor)->is_running(); }));
  const auto again = (*supervisor)->restart();
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_EQ(reported(), 7u);
  // a halt that has ended is not written again
  (*supervisor)->heartbeat().newest_ended_halt = 7;
  (*supervisor)->heartbeat().beat_ns = monotonic_ns() - 2 * kSupervisedStall_ns;
  EXPECT_EQ(reported(), 8u);
  supervisor->reset();
  for (const int file : halt) ::close(file);
}

// A device may outlive sessions and has received the halts of earlier supervisors.
TEST(Supervisor, TheNextSessionsNumbersAreAboveTheLastOnes) {
  std::uint64_t last = 0;
  for (int session = 0; session < 3; ++session) {
    const auto supervisor =
        Supervisor::start({.command = {PALPATE_SUPERVISED_SESSION, "supervise"}, .halt_fds = {}});
    ASSERT_TRUE(supervisor.ok()) << supervisor.error().message();
    Heartbeat& heartbeat = (*supervisor)->heartbeat();
    EXPECT_GT(heartbeat.newest_halt, last);
    EXPECT_EQ(heartbeat.newest_ended_halt, heartbeat.newest_halt) << "none lasts";
    last = heartbeat.newest_halt + 1000;
  }
}

TEST(Supervisor, DoesNotRequestRealTimeSchedulingUnlessAsked) {
  const auto supervisor = Supervisor::start(
      {.command = {PALPATE_SUPERVISED_SESSION, "supervise"}, .halt_fds = {}, .realtime = false});
  ASSERT_TRUE(supervisor.ok()) << supervisor.error().message();
  EXPECT_NE((*supervisor)->scheduler().find("not requested"), std::string::npos)
      << (*supervisor)->scheduler();
}

// A blocked record file delays nothing, and is complete in the end.
TEST(Supervisor, BlockedEventLogDelaysNoHalt) {
  const Pressing session;
  ASSERT_TRUE(session.presses());
  session.fill_record();
  for (int n = 0; n < 2; ++n) {
    const std::int64_t then_ns = monotonic_ns();
    session.signal(SIGSTOP);
    ASSERT_NE(session.rest_after(then_ns), 0) << "the device still pushes";
    session.signal(SIGCONT);
    EXPECT_TRUE(session.acts_again());
  }
  const std::int64_t then_ns = monotonic_ns();
  session.signal(SIGKILL);
  ASSERT_NE(session.rest_after(then_ns), 0) << "the device still pushes";
  const auto record = session.record();
  ASSERT_GE(record.size(), 3u);
  for (std::size_t n = 0; n + 1 < record.size(); ++n)
    EXPECT_NE(record[n].find("\"stall\""), std::string::npos) << record[n];
  EXPECT_NE(record.back().find("\"death\""), std::string::npos) << record.back();
}

// A full disk takes whole lines or none, since another session's lines may follow.
TEST(Supervisor, FullEventLogHasNoPartialLine) {
  const test::TemporaryFolder folder;
  const auto file = folder / "record";
  const int record = ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  ASSERT_GE(record, 0);
  int over[2];
  ASSERT_EQ(::pipe2(over, O_CLOEXEC), 0);
  const pid_t session = ::fork();
  if (session == 0) {
    ::dup2(over[1], STDERR_FILENO);
    const auto supervisor = Supervisor::start(
        {.command = {PALPATE_SUPERVISED_SESSION, "supervise"}, .halt_fds = {}, .event_log_fd = record});
    if (!supervisor.ok()) ::_exit(1);
    // space for part of a line
    rlimit full{};
    ::getrlimit(RLIMIT_FSIZE, &full);
    full.rlim_cur = 20;
    if (::prlimit(supervisor_of(::getpid()), RLIMIT_FSIZE, &full, nullptr) != 0) ::_exit(1);
    ::close(over[0]);
    ::raise(SIGKILL);
  }
  ::close(over[1]);
  int status = 0;
  ASSERT_EQ(::waitpid(session, &status, 0), session);
  ASSERT_TRUE(WIFSIGNALED(status)) << "no supervisor";
  // the supervisor holds the last descriptor of the pipe
  std::string declared;
  for (char byte = 0; ::read(over[0], &byte, 1) == 1;) declared += byte;
  ::close(over[0]);
  EXPECT_NE(declared.find("lacks events"), std::string::npos) << declared;
  EXPECT_EQ(std::filesystem::file_size(file), 0u);
  ::close(record);
}

TEST(Supervisor, IsNotKilledByAProcessIdThatMayHaveBeenReused) {
  const testing::Shared<std::atomic<pid_t>> watching;
  testing::Child child([&] {
    // children are reaped automatically, so the process ID is free as soon as the process has ended
    ::signal(SIGCHLD, SIG_IGN);
    auto supervisor =
        Supervisor::start({.command = {PALPATE_SUPERVISED_SESSION, "supervise"}, .halt_fds = {}});
    if (!supervisor.ok()) ::_exit(1);
    *watching = supervisor_of(::getpid());
    // a supervisor that does not exit
    ::kill(*watching, SIGSTOP);
    if (test::die_of(SYS_kill)) supervisor->reset();
  });
  const bool finished = child.finished();
  EXPECT_TRUE(finished);
  if (!finished && *watching > 0) ::kill(*watching, SIGKILL);
}

TEST(Supervisor, ReportsForkFailure) {
  testing::Child child([] {
    if (!test::forbid_processes()) return;
    const auto supervisor =
        Supervisor::start({.command = {PALPATE_SUPERVISED_SESSION, "supervise"}, .halt_fds = {}});
    const bool reported = !supervisor.ok() && supervisor.error().kind == ErrorKind::kUnavailable &&
                          supervisor.error().what.find("no supervisor") != std::string::npos &&
                          supervisor.error().remedy.find("ulimit -u") != std::string::npos;
    if (!reported) ::_exit(1);
  });
  EXPECT_TRUE(child.finished());
}

TEST(Supervisor, RejectsAProgramThatDoesNotSupervise) {
  for (const char* program : {"/no/such/program", "/bin/true"}) {
    const auto supervisor = Supervisor::start({.command = {program}, .halt_fds = {}});
    ASSERT_FALSE(supervisor.ok()) << program;
    EXPECT_EQ(supervisor.error().kind, ErrorKind::kUnavailable);
    EXPECT_NE(supervisor.error().message().find(program), std::string::npos) << supervisor.error().message();
  }
}

/// A simulated device and the halts that it receives.
class ReportedDevice {
 public:
  ReportedDevice() {
    PALPATE_CHECK(::pipe2(halt_, O_CLOEXEC | O_NONBLOCK) == 0);
    memory_->force_N = 1;
    device_.emplace([this] {
      ::close(halt_[1]);
      testing::be_test_device(*memory_, halt_[0]);
    });
    driver_.emplace(*memory_, halt_[1], Point<Device>(0, 0, 0));
  }
  ~ReportedDevice() {
    device_.reset();
    for (const int file : halt_) ::close(file);
  }
  ReportedDevice(const ReportedDevice&) = delete;
  ReportedDevice& operator=(const ReportedDevice&) = delete;

  void halt(std::uint64_t number) const {
    PALPATE_CHECK(::write(halt_[1], &number, sizeof number) == sizeof number);
  }
  void write_byte() const { PALPATE_CHECK(::write(halt_[1], "x", 1) == 1); }
  const TestDeviceMemory& memory() const { return *memory_; }
  testing::TestDeviceDriver& driver() { return *driver_; }
  testing::Child& process() { return *device_; }
  /// Waits until the device acts, or rests, permanently; false: never.
  bool comes_to(bool act) const {
    int lasts = 0;
    return testing::soon([&] {
      lasts = (memory_->acting_N > 0) == act ? lasts + 1 : 0;
      return lasts == 20;
    });
  }

 private:
  int halt_[2];
  const testing::Shared<TestDeviceMemory> memory_;
  std::optional<testing::Child> device_;
  std::optional<testing::TestDeviceDriver> driver_;
};

TEST(TestDevice, StarvedThroughAResumeItObeysTheNewerHalt) {
  ReportedDevice device;
  ASSERT_TRUE(device.comes_to(true));
  device.process().stop();
  device.halt(1);
  device.driver().resume(1);
  device.halt(2);
  device.process().resume();
  EXPECT_TRUE(device.comes_to(false)) << "it pushes through a halt";
  // nor does a repeated end of the first halt end it
  device.driver().resume(1);
  EXPECT_TRUE(device.comes_to(false));
  device.driver().resume(2);
  EXPECT_TRUE(device.comes_to(true));
  // an outdated end does not revoke a later one
  device.driver().resume(1);
  EXPECT_TRUE(device.comes_to(true));
}

TEST(TestDevice, ContinuesAfterAnEndBeforeTheHalt) {
  ReportedDevice device;
  ASSERT_TRUE(device.comes_to(true));
  device.driver().resume(1);
  device.halt(1);
  EXPECT_TRUE(device.comes_to(true));
  device.halt(2);
  EXPECT_TRUE(device.comes_to(false));
}

TEST(TestDevice, ReadsAllHaltsBeforeItActs) {
  ReportedDevice device;
  ASSERT_TRUE(device.comes_to(true));
  device.process().stop();
  const std::uint32_t changes = device.memory().change_count;
  constexpr std::uint64_t kMany = 500;
  for (std::uint64_t halt = 1; halt <= kMany; ++halt) device.halt(halt);
  device.driver().resume(kMany - 1);
  device.process().resume();
  EXPECT_TRUE(device.comes_to(false));
  EXPECT_EQ(device.memory().change_count, changes + 1) << "it has pushed in between";
  device.driver().resume(kMany);
  EXPECT_TRUE(device.comes_to(true));
}

// When all writers are gone, or a writer does not follow the protocol.
TEST(TestDevice, PermanentHaltCannotBeRevoked) {
  for (const bool number : {true, false}) {
    ReportedDevice device;
    ASSERT_TRUE(device.comes_to(true));
    if (number)
      device.halt(Heartbeat::kPermanentHalt);
    else
      device.write_byte();
    EXPECT_TRUE(device.comes_to(false));
    device.driver().resume(Heartbeat::kPermanentHalt - 1);
    EXPECT_TRUE(device.comes_to(false));
  }
}

// A busy-waiting device at real-time priority would starve other processes on its CPU, supervisors included.
TEST(TestDevice, WaitsWhenItIsAlone) {
  const testing::Shared<TestDeviceMemory> memory;
  memory->force_N = 1;
  int halt[2];
  ASSERT_EQ(::pipe2(halt, O_CLOEXEC), 0);
  const testing::Child device([&] {
    ::close(halt[1]);
    testing::be_test_device(*memory, halt[0]);
  });
  ASSERT_TRUE(testing::soon([&] { return memory->acting_N > 0; }));
  for (const int file : halt) ::close(file);
  ASSERT_TRUE(testing::soon([&] { return memory->at_rest_since() != 0; }));
  clockid_t clock{};
  ASSERT_EQ(::clock_getcpuclockid(device.id(), &clock), 0);
  const auto used_ns = [&] {
    timespec used{};
    ::clock_gettime(clock, &used);
    return used.tv_sec * 1'000'000'000LL + used.tv_nsec;
  };
  const std::int64_t before_ns = used_ns(), then_ns = monotonic_ns();
  std::this_thread::sleep_for(200ms);
  EXPECT_LT(2 * (used_ns() - before_ns), monotonic_ns() - then_ns);
}

TEST(Supervise, ExplainsItselfWhenRunManually) {
  EXPECT_EQ(supervise({}), 2);
  EXPECT_EQ(supervise({"1", "0", "0"}), 2);
  EXPECT_EQ(supervise({"-1", "0", "0"}), 2);
  EXPECT_EQ(supervise({"9", "0", "0"}), 2);
}

}  // namespace
}  // namespace palpate
