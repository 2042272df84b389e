#include <dlfcn.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <system_error>
#include <thread>

#include "palpate/base/clock.h"
#include "palpate/plugin/plugin_driver.h"
#include "palpate/servo/realtime.h"
#include "plugin/exchange.h"

namespace palpate {
namespace {

using plugin::Request;

constexpr double kNoValue = std::numeric_limits<double>::quiet_NaN();
constexpr std::int64_t kSilence_ns = static_cast<std::int64_t>(PluginDriver::kSilence_s * 1e9);
constexpr int kPoll_ms = 1;
// above the servo's, because it has to answer within the servo's tick
constexpr int kPriority = 85;

/// The process of a plug-in: a thread that calls it, and one that halts it.
class PluginHost {
 public:
  explicit PluginHost(const char* file) : file_(file) {
    driver_.size = sizeof driver_;
    driver_.device_count = 1;
    for (plp_driver_device& device : driver_.devices) {
      device = {};
      device.size = sizeof device;
      device.degrees_of_freedom_in = device.degrees_of_freedom_out = 3;
      device.axes[0] = device.axes[4] = device.axes[8] = 1;
      for (double* value : {&device.peak_force_N, &device.continuous_force_N, &device.peak_torque_Nmm,
                            &device.peak_gripper_N, &device.position_step_mm, &device.stiffness_N_per_mm,
                            &device.delay_s, &device.mass_kg, &device.damping_N_s_per_m})
        *value = kNoValue;
      for (int axis = 0; axis < 3; ++axis)
        device.workspace_low_mm[axis] = device.workspace_high_mm[axis] = kNoValue;
    }
    for (plp_driver_sample& sample : samples_.samples) {
      sample = {};
      sample.size = sizeof sample;
      sample.orientation_wxyz[0] = 1;
      for (int axis = 0; axis < 3; ++axis)
        sample.velocity_mm_s[axis] = sample.angular_velocity_rad_s[axis] = kNoValue;
      sample.gripper_rad = kNoValue;
    }
  }

  int run() {
    Request request;
    while (receive(request)) {
      switch (request.kind) {
        case Request::Kind::kLoad:
          reply(load());
          break;
        case Request::Kind::kOpen:
          reply(open(request.may_move));
          break;
        case Request::Kind::kRead:
          read(request.number);
          break;
        case Request::Kind::kWrite:
          write(request);
          break;
        case Request::Kind::kClose:
          close();
          return 0;
      }
    }
    close();
    return 0;
  }

 private:
  // false: the session is gone
  bool receive(Request& request) {
    for (;;) {
      const ssize_t received = ::recv(plugin::kSocketFile, &request, sizeof request, 0);
      if (received < 0 && errno == EINTR) continue;
      requested_ns_.store(monotonic_ns());
      return received == static_cast<ssize_t>(sizeof request);
    }
  }
  template <class Message>
  void reply(const Message& message) {
    ::send(plugin::kSocketFile, &message, sizeof message, MSG_NOSIGNAL);
  }

  plugin::Devices described(const std::string& error) const {
    plugin::Devices reply;
    reply.is_ready = error.empty();
    reply.count = driver_.device_count;
    std::snprintf(reply.error.data(), reply.error.size(), "%s", error.c_str());
    std::ranges::copy(driver_.devices, reply.devices.begin());
    return reply;
  }

  plugin::Devices load() {
    void* const library = ::dlopen(file_, RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
      const char* const reason = ::dlerror();
      return described(std::string("cannot be loaded: ") + (reason ? reason : "the system gives no reason"));
    }
    using Entry = std::int32_t (*)(plp_driver*);
    const auto entry = reinterpret_cast<Entry>(::dlsym(library, "plp_driver_v1"));
    if (entry == nullptr) return described("does not export plp_driver_v1");
    if (entry(&driver_) != 0) return described("plp_driver_v1 failed");
    if (driver_.device_count < 1 || driver_.device_count > PLP_DRIVER_MAX_DEVICES)
      return described("states " + std::to_string(driver_.device_count) + " devices, and 1 to " +
                       std::to_string(PLP_DRIVER_MAX_DEVICES) + " are possible");
    if (!driver_.open || !driver_.read || !driver_.write || !driver_.halt || !driver_.close)
      return described("lacks one of open, read, write, halt and close");
    if (driver_.size != sizeof driver_ ||
        std::ranges::any_of(driver_.devices,
                            [](const plp_driver_device& device) { return device.size != sizeof device; }))
      return described("was built for structs of another size");
    return described("");
  }

  plugin::Devices open(std::int32_t may_move) {
    std::array<char, 256> error{};
    const bool is_open =
        driver_.open(driver_.context, may_move, driver_.devices, error.data(), error.size()) == 0;
    error.back() = '\0';
    if (!is_open) return described(error.front() != '\0' ? error.data() : "the device does not answer");
    is_open_ = true;
    try {
      std::thread([this] { watch(); }).detach();
    } catch (const std::system_error& failed) {
      return described(std::string("cannot start a thread: ") + failed.what());
    }
    make_this_thread_realtime({.fifo = true,
                               .priority = kPriority,
                               .lock_memory = true,
                               .cpu = -1,
                               .priorities_above = 1,
                               .name = "plug-in"});
    return described("");
  }

  // the plug-in's calls, timed for watch()
  template <class Call>
  std::int32_t timed(const Call& call) {
    called_ns_.store(monotonic_ns());
    const std::int32_t status = call();
    called_ns_.store(0);
    return status;
  }

  void read(std::uint64_t number) {
    for (plp_driver_sample& sample : samples_.samples) sample.age_s = 0;
    const bool is_read = timed([&] { return driver_.read(driver_.context, samples_.samples.data()); }) == 0;
    samples_.number = number;
    samples_.is_read = is_read && is_written_;
    reply(samples_);
  }

  void write(const Request& request) {
    const bool halted = halt_number_.load() > request.halts_ended;
    auto commands = request.commands;
    if (halted)
      for (plp_driver_command& command : commands) command = {sizeof command, 0, {}, {}, 0};
    const std::int64_t started_ns = monotonic_ns();
    is_written_ = timed([&] { return driver_.write(driver_.context, commands.data()); }) == 0;
    // a command that was on its way while the device was halted has switched it on again
    const bool is_late = monotonic_ns() - started_ns > kSilence_ns;
    if (!is_written_ || halted || is_late || halt_number_.load() > request.halts_ended)
      driver_.halt(driver_.context);
  }

  void close() {
    if (!is_open_) return;
    is_open_ = false;
    driver_.halt(driver_.context);
    driver_.close(driver_.context);
  }

  // ---- the watching thread: halts by the session's watchdog, calls that hang, a session that is silent
  void watch() noexcept {
    pollfd halts{plugin::kHaltFile, POLLIN, 0};
    bool is_gone = false, was_silent = false;
    for (;;) {
      if (!is_gone && ::poll(&halts, 1, kPoll_ms) > 0) {
        std::array<std::uint64_t, 64> numbers{};
        const ssize_t received = ::read(plugin::kHaltFile, numbers.data(), sizeof numbers);
        is_gone = received <= 0;
        if (received > 0) halt_number_.store(std::max(halt_number_.load(), std::ranges::max(numbers)));
        driver_.halt(driver_.context);
      } else if (is_gone) {
        std::this_thread::sleep_for(std::chrono::milliseconds(kPoll_ms));
      }
      const std::int64_t now_ns = monotonic_ns(), called_ns = called_ns_.load();
      const bool is_silent =
          (called_ns != 0 && now_ns - called_ns > kSilence_ns) || now_ns - requested_ns_.load() > kSilence_ns;
      if (is_silent && !was_silent) driver_.halt(driver_.context);
      was_silent = is_silent;
    }
  }

  const char* const file_;
  plp_driver driver_{};
  plugin::Samples samples_;
  bool is_open_ = false, is_written_ = true;
  std::atomic<std::int64_t> called_ns_{0}, requested_ns_{0};
  std::atomic<std::uint64_t> halt_number_{0};
};

}  // namespace

int serve_plugin(const std::vector<std::string>& arguments) {
  if (arguments.size() != 1) return 2;
  // keys of the terminal are for the session, which ends this process
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGTSTP, SIGTTIN, SIGTTOU, SIGPIPE})
    ::signal(signal, SIG_IGN);
  ::prctl(PR_SET_DUMPABLE, 0, 0, 0, 0);
  PluginHost host(arguments.front().c_str());
  const int code = host.run();
  // without destructors of the plug-in, which its own threads may still use
  ::_exit(code);
}

}  // namespace palpate
