// supervised_session MEMORY_FILE HALT_FILE RECORD_FILE KILL_FROZEN RECORDING
// supervised_session supervise ...
//
// A servo loop on the real clock with a supervisor, and a device held by another process. Writes a byte when
// the force is fully on, and then executes commands of one letter each from its standard input. Records
// unless RECORDING is empty. For supervisor_test.cc.
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <thread>

#include "contact/test_model.h"
#include "palpate/base/check.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/supervisor/supervisor.h"
#include "supervisor/test_device.h"
#include "supervisor/test_recorder.h"

namespace palpate {
namespace {

void wait_for_full_force(const ServoLoop& loop) {
  for (;;) {
    const DeviceTick now = loop.snapshot().device[0];
    if (std::abs(now.force_N[0]) > 0.3 && (now.flags & (kFlagRamp | kFaultFlags)) == 0) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

void in_another_thread(void (*work)()) {
  std::thread(work).detach();
  for (;;) ::pause();
}

// prevents its file from growing; returns when the recorder has failed because of it, or after a time limit
void fill_disk(const Recorder& recorder, const std::filesystem::path& file) {
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit full{};
  ::getrlimit(RLIMIT_FSIZE, &full);
  full.rlim_cur = std::filesystem::file_size(file);
  ::setrlimit(RLIMIT_FSIZE, &full);
  for (int n = 0; n < 30'000 && !recorder.failure(); ++n)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

// false: regular end
bool obey(char order, testing::TestDeviceDriver& driver) {
  switch (order) {
    case 'v':
      driver.throws = true;
      for (;;) ::pause();
    case 'w':
      driver.throws_in_halt = true;
      driver.hangs = true;
      for (;;) ::pause();
    case 'r':
      testing::recorder_throws = true;
      for (;;) ::pause();
    case 'z':
      driver.freeze();
      break;
    case 'c':
      // output is no longer read
      std::signal(SIGPIPE, SIG_IGN);
      ::close(STDOUT_FILENO);
      ::close(STDERR_FILENO);
      break;
    case 'a':
      std::abort();
    case 't':
      in_another_thread([] { std::terminate(); });
      break;
    case 'x':
      in_another_thread(testing::throw_for_a_test);
      break;
    case 's':
      in_another_thread([] { std::raise(SIGSEGV); });
      break;
    case '_':
      ::_exit(0);
    case 'e':
      std::exit(0);
    case 'h':
      driver.hangs = true;
      break;
    case 'g':
      driver.hangs = false;
      testing::TestDeviceDriver::frozen = false;
      break;
    case 'q':
      return false;
    default:
      break;
  }
  return true;
}

// @param halt_fd  -1: the supervisor gets none, as if the device were inside this process
int run(int memory_file, int halt_fd, int event_log_fd, bool kill_frozen,
        const std::filesystem::path& recording) {
  void* room =
      ::mmap(nullptr, sizeof(testing::TestDeviceMemory), PROT_READ | PROT_WRITE, MAP_SHARED, memory_file, 0);
  PALPATE_CHECK(room != MAP_FAILED);
  auto& memory = *static_cast<testing::TestDeviceMemory*>(room);
  testing::TestDeviceDriver driver(memory, halt_fd, Point<Device>(testing::kBoneRadius_mm, 0, 0));
  SupervisorSettings supervised{.command = {"/proc/self/exe", "supervise"},
                                .halt_fds = {},
                                .kill_frozen = kill_frozen,
                                .event_log_fd = event_log_fd};
  if (halt_fd >= 0) supervised.halt_fds.push_back(halt_fd);
  auto supervisor = Supervisor::start(supervised);
  PALPATE_CHECK(supervisor.ok());
  Model model = testing::ball_model({1, 1, 1});
  LoopSettings settings;
  settings.heartbeat = &(*supervisor)->heartbeat();
  // large enough for a recorder delayed by a busy machine
  settings.ring_s = 30;
  auto loop = ServoLoop::start(std::make_shared<const Model>(std::move(model)), driver, {},
                               {WorkspaceSettings{}}, settings);
  PALPATE_CHECK(loop.ok());
  const auto recorder = testing::start_recorder(**loop, recording);
  wait_for_full_force(**loop);
  char order = 0;
  for (;;) {
    PALPATE_CHECK(order == 'c' || ::write(STDOUT_FILENO, ".", 1) == 1);
    if (::read(STDIN_FILENO, &order, 1) != 1 || !obey(order, driver)) break;
    if (order == 'f') fill_disk(*recorder, recording);
    // the force returns after any disturbance
    if (order == 'g') wait_for_full_force(**loop);
  }
  (*loop)->stop();
  return recorder->finish(0, 0, {}).ok() ? 0 : 1;
}

}  // namespace
}  // namespace palpate

int main(int count, char** arguments) {
  const std::vector<std::string> words(arguments, arguments + count);
  if (count >= 2 && words[1] == "supervise") return palpate::supervise({words.begin() + 2, words.end()});
  if (count != 6) {
    std::fprintf(stderr,
                 "usage: supervised_session MEMORY_FILE HALT_FILE RECORD_FILE KILL_FROZEN RECORDING\n");
    return 2;
  }
  return palpate::run(std::atoi(arguments[1]), std::atoi(arguments[2]), std::atoi(arguments[3]),
                      std::atoi(arguments[4]) != 0, arguments[5]);
}
