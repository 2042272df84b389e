#include "palpate/plugin/plugin_driver.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <ctime>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "palpate/base/child_process.h"
#include "palpate/base/clock.h"
#include "palpate/base/printable.h"
#include "palpate/device/telemetry.h"
#include "plugin/exchange.h"

namespace palpate {
namespace plugin {

/// Reason why a plug-in was abandoned.
enum class Loss : std::uint8_t { kNone, kEnded, kSilent, kNotFinite, kSize };

}  // namespace plugin

namespace {

using plugin::Loss;
using plugin::Request;

// time limits for loading a plug-in and for opening its device, which may calibrate then
constexpr int kLoadPatience_ms = 10'000, kOpenPatience_ms = 30'000;
// time limit for a plug-in to disconnect after the request to close
constexpr int kClosePatience_ms = 2000;

std::optional<double> known(double value) {
  return std::isfinite(value) && value > 0 ? std::optional(value) : std::nullopt;
}

bool all_finite(std::span<const double> values) {
  return std::ranges::all_of(values, [](double value) { return std::isfinite(value); });
}

Result<DeviceInfo> info_of(const plp_driver_device& device, const std::string& where) {
  const auto wrong = [&](const char* what) {
    return Error{ErrorKind::kUnavailable, what, where, "correct the plug-in (include/palpate_driver.h)"};
  };
  const Eigen::Matrix3d axes = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(device.axes);
  if (!((axes.transpose() * axes - Eigen::Matrix3d::Identity()).norm() < 1e-6) || !(axes.determinant() > 0))
    return wrong("states axes that are not a rotation");
  if (device.buttons < 0 || device.buttons > 32) return wrong("states a number of buttons beyond 32");
  const auto is_freedom = [](std::int32_t number) { return number >= 0 && number <= 7; };
  if (!is_freedom(device.degrees_of_freedom_in) || !is_freedom(device.degrees_of_freedom_out))
    return wrong("states degrees of freedom beyond 7");
  DeviceInfo info;
  std::array<char, sizeof device.name + 1> name{};
  std::ranges::copy(device.name, name.begin());
  info.name = name[0] != '\0' ? printable_name(name.data()) : where;
  info.R_WorldDevice = Rotation<World, Device>(Eigen::Quaterniond(axes));
  info.peak_force_N = known(device.peak_force_N);
  info.continuous_force_N = known(device.continuous_force_N);
  info.peak_torque_Nmm = known(device.peak_torque_Nmm);
  info.peak_gripper_N = known(device.peak_gripper_N);
  info.position_step_mm = known(device.position_step_mm);
  info.stiffness_N_per_mm = known(device.stiffness_N_per_mm);
  info.delay_s = known(device.delay_s);
  info.mass_kg = known(device.mass_kg);
  info.damping_N_s_per_m = known(device.damping_N_s_per_m);
  if (all_finite(device.workspace_low_mm) && all_finite(device.workspace_high_mm))
    info.workspace = {Point<Device>(Eigen::Vector3d(device.workspace_low_mm)),
                      Point<Device>(Eigen::Vector3d(device.workspace_high_mm))};
  info.degrees_of_freedom_in = device.degrees_of_freedom_in;
  info.degrees_of_freedom_out = device.degrees_of_freedom_out;
  info.buttons = device.buttons;
  info.gripper = device.has_gripper != 0;
  info.moves_by_itself = device.moves_by_itself != 0;
  return info;
}

/// Defect of a sample; Loss::kNone if it is usable.
Loss fault_in(const plp_driver_sample& sample) {
  if (sample.size != sizeof sample) return Loss::kSize;
  if (!all_finite(sample.tip_mm) || !all_finite(sample.orientation_wxyz) || !std::isfinite(sample.age_s))
    return Loss::kNotFinite;
  const double length = Eigen::Map<const Eigen::Vector4d>(sample.orientation_wxyz).norm();
  return length > 0.5 && length < 2 ? Loss::kNone : Loss::kNotFinite;
}

void convert(const plp_driver_sample& from, std::int64_t taken_ns, DeviceSample& to) {
  const double* const q = from.orientation_wxyz;
  to.tip = Point<Device>(Eigen::Vector3d(from.tip_mm));
  to.R_DeviceTool = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized();
  to.velocity_mm_s = Vector<Device>(Eigen::Vector3d(from.velocity_mm_s));
  to.angular_velocity_rad_s = Vector<Device>(Eigen::Vector3d(from.angular_velocity_rad_s));
  to.gripper_rad = from.gripper_rad;
  to.buttons = from.buttons;
  to.taken_ns = taken_ns - to_ns(std::clamp(from.age_s, 0.0, 1.0));
}

plp_driver_command command_of(const DeviceCommand& command) {
  plp_driver_command made{};
  made.size = sizeof made;
  for (int axis = 0; axis < 3; ++axis) {
    made.force_N[axis] = command.force_N[axis];
    made.torque_Nmm[axis] = command.torque_Nmm[axis];
  }
  made.gripper_N = command.gripper_N;
  return made;
}

}  // namespace

class PluginDriver::Core {
 public:
  explicit Core(const PluginSettings& settings)
      : settings_(settings), where_(printable_name(settings.file.filename().string())) {
    info_.resize(1);
    info_[0].name = where_;
  }
  ~Core() { close(); }
  Core(const Core&) = delete;
  Core& operator=(const Core&) = delete;

  std::span<const DeviceInfo> devices() const { return info_; }

  /// Starts the process and loads the plug-in; connects to nothing.
  Result<void> load() {
    if (socket_ >= 0) return {};
    if (auto started = start(); !started) return started;
    Request request;
    request.kind = Request::Kind::kLoad;
    return ask(request, kLoadPatience_ms);
  }

  Result<void> open(bool may_move) {
    if (is_open_) return {};
    if (auto loaded = load(); !loaded) return loaded;
    for (const DeviceInfo& info : info_)
      if (auto agreed = require_consent(info, may_move); !agreed) return agreed;
    Request request;
    request.kind = Request::Kind::kOpen;
    request.may_move = may_move;
    auto opened = ask(request, kOpenPatience_ms);
    is_open_ = opened.ok();
    return opened;
  }

  void run(ServoFunction& servo, ServoClock& clock) noexcept {
    std::array<DeviceSample, PLP_DRIVER_MAX_DEVICES> samples;
    std::array<DeviceCommand, PLP_DRIVER_MAX_DEVICES> commands{};
    const std::size_t count = info_.size();
    answered_ns_ = monotonic_ns();
    while (clock.wait()) {
      read(std::span(samples).first(count));
      servo.update(std::span(samples).first(count), std::span(commands).first(count));
      write(std::span(commands).first(count));
    }
    commands = {};
    write(std::span(commands).first(count));
  }

  void halt() noexcept {
    const std::uint64_t number = halts_.fetch_add(1) + 1;
    // a full pipe holds unread halts
    if (halt_fd_ >= 0) [[maybe_unused]]
      const ssize_t written = ::write(halt_fd_, &number, sizeof number);
  }
  void resume() noexcept { halts_ended_.store(halts_.load()); }

  std::optional<Error> failure() const {
    const auto error = [&](std::string what, const char* remedy) {
      return Error{ErrorKind::kUnavailable, std::move(what), where_, remedy};
    };
    constexpr const char* kMend = "correct the plug-in, and restart the session";
    switch (loss_.load()) {
      case Loss::kNone:
        break;
      case Loss::kEnded:
        return error("the plug-in's process has ended" + how_it_ended(), kMend);
      case Loss::kSilent:
        // a crash may take longer than that
        if (const auto how = ending(); how && (how->si_code == CLD_EXITED || how->si_status != SIGKILL))
          return error("the plug-in's process has ended" + how_it_ended(), kMend);
        return error("the plug-in did not answer for 0.1 s and was ended", kMend);
      case Loss::kNotFinite:
        return error("the plug-in reported a pose that is not finite, and was ended", kMend);
      case Loss::kSize:
        return error("the plug-in reported a sample of another size, and was ended", kMend);
    }
    if (!failed_.load()) return std::nullopt;
    return error("the plug-in cannot read or write its device", "check the device's cable and power");
  }

 private:
  // ---- the opening thread
  Result<void> start() {
    std::array<int, 2> sockets{-1, -1}, halts{-1, -1};
    const auto refused = [&](const char* what) {
      const Error error{
          ErrorKind::kUnavailable, std::string(what) + ": " + std::strerror(errno), where_,
          "close other programs, or raise the limits of processes and files (ulimit -u, ulimit -n)"};
      for (const int file : {sockets[0], sockets[1], halts[0], halts[1]})
        if (file >= 0) ::close(file);
      return error;
    };
    if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, sockets.data()) != 0 ||
        ::pipe2(halts.data(), O_CLOEXEC | O_NONBLOCK) != 0)
      return refused("cannot connect to the plug-in's process");
    std::vector<std::string> words = settings_.command;
    std::error_code ignored;
    // dlopen would search for a bare name
    words.push_back(std::filesystem::absolute(settings_.file, ignored).string());
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);

    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawnattr_init(&attributes);
    ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    // beyond the numbers of both ends, so that no copy overwrites the other
    const int far = 10 + std::max(sockets[1], halts[0]);
    ::posix_spawn_file_actions_adddup2(&actions, sockets[1], far);
    ::posix_spawn_file_actions_adddup2(&actions, halts[0], far + 1);
    ::posix_spawn_file_actions_adddup2(&actions, far, plugin::kSocketFile);
    ::posix_spawn_file_actions_adddup2(&actions, far + 1, plugin::kHaltFile);
    ::posix_spawn_file_actions_addclosefrom_np(&actions, plugin::kHaltFile + 1);
    sigset_t none;
    ::sigemptyset(&none);
    ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK);
    ::posix_spawnattr_setsigmask(&attributes, &none);
    pid_t process = -1;
    errno = ::posix_spawn(&process, arguments[0], &actions, &attributes, arguments.data(), environ);
    ::posix_spawn_file_actions_destroy(&actions);
    ::posix_spawnattr_destroy(&attributes);
    if (errno != 0) return refused("cannot start a process for the plug-in");
    ::close(std::exchange(sockets[1], -1));
    ::close(std::exchange(halts[0], -1));
    process_ = ChildProcess(process);
    socket_ = sockets[0];
    halt_fd_ = halts[1];
    return {};
  }

  // waits for the devices' description
  Result<void> ask(const Request& request, int patience_ms) {
    plugin::Devices reply;
    ::send(socket_, &request, sizeof request, MSG_NOSIGNAL);
    pollfd answer{socket_, POLLIN, 0};
    const int ready = ::poll(&answer, 1, patience_ms);
    const auto failed = [&](const std::string& what) {
      const Error error{ErrorKind::kUnavailable, what, where_,
                        "docs/guide/plug-ins.md lists the requirements of a plug-in"};
      close();
      return error;
    };
    if (ready == 0) return failed("does not answer");
    if (::recv(socket_, &reply, sizeof reply, 0) != static_cast<ssize_t>(sizeof reply))
      return failed("the plug-in's process has ended" + how_it_ended());
    reply.error.back() = '\0';
    if (reply.is_ready == 0) return failed(printable(reply.error.data()));
    std::vector<DeviceInfo> infos;
    for (std::size_t n = 0; n < std::clamp<std::size_t>(reply.count, 1, PLP_DRIVER_MAX_DEVICES); ++n) {
      auto info = info_of(reply.devices[n], where_);
      if (!info) {
        close();
        return info.error();
      }
      infos.push_back(*std::move(info));
    }
    info_ = std::move(infos);
    return {};
  }

  void close() {
    if (socket_ < 0) return;
    Request request;
    request.kind = Request::Kind::kClose;
    if (loss_.load() == Loss::kNone && ::send(socket_, &request, sizeof request, MSG_NOSIGNAL) > 0) {
      // it ends by itself where it disconnects in time
      pollfd ended{process_.pidfd(), POLLIN, 0};
      if (ended.fd >= 0) ::poll(&ended, 1, kClosePatience_ms);
    }
    if (loss_.load() != Loss::kNone && loss_.load() != Loss::kEnded && !is_ended_) {
      const auto patience_ns = lost_ns_ + to_ns(kHaltPatience_s) - monotonic_ns();
      std::this_thread::sleep_for(std::chrono::nanoseconds(std::max<std::int64_t>(patience_ns, 0)));
    }
    process_.end();
    ::close(std::exchange(socket_, -1));
    ::close(std::exchange(halt_fd_, -1));
    is_open_ = false;
  }

  // Exit status of the process; empty: it is running.
  std::optional<siginfo_t> ending() const {
    siginfo_t how{};
    if (process_.pidfd() < 0 ||
        ::waitid(P_PIDFD, static_cast<id_t>(process_.pidfd()), &how, WEXITED | WNOWAIT | WNOHANG) != 0 ||
        how.si_pid == 0)
      return {};
    return how;
  }
  std::string how_it_ended() const {
    const auto how = ending();
    if (!how) return "";
    if (how->si_code == CLD_EXITED) return " with exit code " + std::to_string(how->si_status);
    return " by signal " + std::to_string(how->si_status) + " (" + ::strsignal(how->si_status) + ")";
  }

  // ---- the servo thread
  void abandon(Loss loss) noexcept {
    lost_ns_ = monotonic_ns();
    loss_.store(loss);
    if (loss != Loss::kEnded) halt();
  }
  // Ends an abandoned process once its watching thread has had time to halt the device. That takes a
  // millisecond, and longer where the processor is busy.
  void end_abandoned() noexcept {
    if (is_ended_ || loss_.load() == Loss::kEnded || monotonic_ns() - lost_ns_ < to_ns(kHaltPatience_s))
      return;
    is_ended_ = true;
    if (process_.pidfd() >= 0) ::syscall(SYS_pidfd_send_signal, process_.pidfd(), SIGKILL, nullptr, 0);
  }

  void read(std::span<DeviceSample> samples) noexcept {
    if (loss_.load() == Loss::kNone) request_samples(samples);
    if (loss_.load() == Loss::kNone) return;
    end_abandoned();
    for (DeviceSample& sample : samples) sample.fault = true;
  }

  void request_samples(std::span<DeviceSample> samples) noexcept {
    const std::int64_t requested_ns = monotonic_ns(), until_ns = requested_ns + to_ns(kTimeout_s);
    if (requested_ns - answered_ns_ > to_ns(kAbandoned_s)) return abandon(Loss::kSilent);
    // one pending request: a plug-in that is late is not asked again
    if (pending_ns_ == 0) {
      Request request;
      request.kind = Request::Kind::kRead;
      request.number = ++number_;
      if (::send(socket_, &request, sizeof request, MSG_NOSIGNAL | MSG_DONTWAIT) < 0 && errno == EPIPE)
        return abandon(Loss::kEnded);
      pending_ns_ = requested_ns;
    }
    for (std::int64_t now_ns = requested_ns; now_ns < until_ns; now_ns = monotonic_ns()) {
      pollfd answer{socket_, POLLIN, 0};
      const timespec wait{0, static_cast<long>(until_ns - now_ns)};
      if (::ppoll(&answer, 1, &wait, nullptr) <= 0) continue;
      plugin::Samples reply;
      const ssize_t received = ::recv(socket_, &reply, sizeof reply, MSG_DONTWAIT);
      if (received < 0 && (errno == EAGAIN || errno == EINTR)) continue;
      if (received != static_cast<ssize_t>(sizeof reply)) return abandon(Loss::kEnded);
      if (reply.number != number_) continue;
      answered_ns_ = monotonic_ns();
      return accept(reply, std::exchange(pending_ns_, 0), samples);
    }
  }

  void accept(const plugin::Samples& reply, std::int64_t requested_ns,
              std::span<DeviceSample> samples) noexcept {
    failed_.store(reply.is_read == 0);
    for (std::size_t n = 0; n < samples.size(); ++n) {
      samples[n].fault = reply.is_read == 0;
      // the last pose stays, and ages
      if (reply.is_read == 0) continue;
      const plp_driver_sample& sample = reply.samples[n];
      if (const Loss loss = fault_in(sample); loss != Loss::kNone) return abandon(loss);
      samples[n].fault = sample.fault != 0;
      // time of the request: the earliest time at which the plug-in can have sampled it
      convert(sample, requested_ns, samples[n]);
    }
  }

  void write(std::span<const DeviceCommand> commands) noexcept {
    if (loss_.load() != Loss::kNone || pending_ns_ != 0) return;
    Request request;
    request.kind = Request::Kind::kWrite;
    request.halts_ended = halts_ended_.load();
    for (std::size_t n = 0; n < commands.size(); ++n) request.commands[n] = command_of(commands[n]);
    ::send(socket_, &request, sizeof request, MSG_NOSIGNAL | MSG_DONTWAIT);
  }

  const PluginSettings settings_;
  const std::string where_;
  std::vector<DeviceInfo> info_;
  ChildProcess process_;
  int socket_ = -1, halt_fd_ = -1;
  bool is_open_ = false;
  std::uint64_t number_ = 0;
  std::int64_t pending_ns_ = 0;   ///< Time of the request that has no reply yet; 0: none
  std::int64_t answered_ns_ = 0;  ///< Time of the latest reply
  std::int64_t lost_ns_ = 0;      ///< Time at which it was abandoned
  bool is_ended_ = false;         ///< Whether it has been killed since
  std::atomic<std::uint64_t> halts_{0}, halts_ended_{0};
  std::atomic<Loss> loss_{Loss::kNone};
  std::atomic<bool> failed_{false};
};

PluginDriver::PluginDriver(const PluginSettings& settings) : core_(std::make_unique<Core>(settings)) {}
PluginDriver::~PluginDriver() = default;

std::span<const DeviceInfo> PluginDriver::devices() const {
  return core_->devices();
}

Result<void> PluginDriver::open(bool may_move) {
  return core_->open(may_move);
}

void PluginDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  core_->run(servo, clock);
}

void PluginDriver::halt() noexcept {
  core_->halt();
}

void PluginDriver::resume(std::uint64_t /*newest*/) noexcept {
  core_->resume();
}

std::optional<Error> PluginDriver::failure() const {
  return core_->failure();
}

DeviceReport PluginDriver::probe(const PluginSettings& settings) {
  DeviceReport report;
  Core core(settings);
  const auto loaded = core.load();
  report.checks.push_back({"plug-in " + printable_name(settings.file.string()), loaded.ok(),
                           loaded ? "loads" : loaded.error().what, loaded ? "" : loaded.error().remedy});
  if (loaded)
    for (const DeviceInfo& info : core.devices()) report.connected.push_back({info.name, "ready"});
  return report;
}

DeviceVendor plugin_vendor(const PluginSettings& settings) {
  return {kPluginPrefix + settings.file.string(), "plug-in " + printable_name(settings.file.string()),
          [settings] { return std::make_unique<PluginDriver>(settings); },
          [settings] { return PluginDriver::probe(settings); }};
}

}  // namespace palpate
