#include "palpate/spacemouse/spacemouse_driver.h"

#include <fcntl.h>
#include <linux/input.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <set>
#include <system_error>
#include <thread>
#include <vector>

#include "palpate/base/clock.h"
#include "palpate/base/printable.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/usb.h"

namespace palpate {
namespace {

constexpr auto kFindEvery = std::chrono::milliseconds(100);
constexpr int kPoll_ms = 20;
// upper limit of the integration step, so that a stall of the servo does not move the tip
constexpr double kMaxStep_s = 0.02;
// dead zone as a fraction of the cap's range
constexpr double kRest = 0.125;
constexpr std::uint16_t k3Dconnexion = 0x256f, kLogitech = 0x046d;

std::string line_in(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

struct FoundMouse {
  std::filesystem::path file;
  std::string name;
  bool may_read = false;
};

// identified by vendor; Logitech's, who made the first ones, also by name
std::vector<FoundMouse> find_mice(const std::filesystem::path& root) {
  std::set<std::filesystem::path> events;
  std::error_code failed;
  for (std::filesystem::directory_iterator it(root / "sys/class/input", failed), end; !failed && it != end;
       it.increment(failed))
    if (it->path().filename().string().starts_with("event")) events.insert(it->path());
  std::vector<FoundMouse> found;
  for (const auto& event : events) {
    const std::string name = line_in(event / "device/name");
    const unsigned long vendor = std::strtoul(line_in(event / "device/id/vendor").c_str(), nullptr, 16);
    const bool named =
        name.find("Space") != std::string::npos || name.find("3Dconnexion") != std::string::npos;
    if (vendor != k3Dconnexion && !(vendor == kLogitech && named)) continue;
    const auto file = root / "dev/input" / event.filename();
    found.push_back({file, printable_name(name), ::access(file.c_str(), R_OK) == 0});
  }
  return found;
}

Result<FoundMouse> choose_mouse(const SpaceMouseSettings& settings) {
  if (!settings.file.empty())
    return FoundMouse{settings.file, "SpaceMouse", ::access(settings.file.c_str(), R_OK) == 0};
  const auto found = find_mice(settings.root);
  if (found.empty())
    return Error{ErrorKind::kUnavailable, "no SpaceMouse is connected", "spacemouse",
                 "connect it or its receiver; stop 3Dconnexion's own driver, which uses it exclusively"};
  const auto readable = std::ranges::find_if(found, &FoundMouse::may_read);
  return readable == found.end() ? found.front() : *readable;
}

Error access_denied(const FoundMouse& mouse) {
  return {ErrorKind::kUnavailable, "this account may not read " + printable_name(mouse.file.string()),
          "spacemouse", udev_remedy()};
}

/// Deflection of the cap, -1 to 1: right, forward, up, and rotation about each.
using Deflection = std::array<double, 6>;

// mapping of a kernel axis to ours; kernel axes point right, towards the user, down
struct MouseAxis {
  std::size_t ours;
  double sign;
};
std::optional<MouseAxis> axis_of(unsigned code) {
  // REL_X ... REL_RZ and ABS_X ... ABS_RZ have the same six codes
  if (code > 5) return std::nullopt;
  const bool about_right_axis = code % 3 == 0;
  return MouseAxis{code, about_right_axis ? 1.0 : -1.0};
}

double speed_of(double deflection) {
  const double beyond = std::abs(deflection) - kRest;
  if (!(beyond > 0)) return 0;
  return std::copysign(std::min(1.0, beyond / (1 - kRest)), deflection);
}

}  // namespace

class SpaceMouseDriver::Core {
 public:
  explicit Core(const SpaceMouseSettings& settings) : settings_(settings) {
    info_.name = "SpaceMouse";
    info_.simulated = true;
    info_.degrees_of_freedom_in = 6;
    info_.degrees_of_freedom_out = 0;
    info_.buttons = 2;
    const double half = kHalfReach_mm;
    info_.workspace = {Point<Device>(-half, -half, -half), Point<Device>(half, half, half)};
  }
  ~Core() {
    end_.store(true);
    if (reader_.joinable()) reader_.join();
    if (file_ >= 0) ::close(file_);
  }

  std::span<const DeviceInfo> devices() const { return {&info_, 1}; }

  Result<void> open() {
    if (reader_.joinable()) return {};
    const auto mouse = choose_mouse(settings_);
    if (!mouse) return mouse.error();
    file_ = ::open(mouse->file.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (file_ < 0) {
      if (errno == EACCES || errno == EPERM) return access_denied(*mouse);
      return Error{ErrorKind::kUnavailable, std::string("cannot be opened: ") + std::strerror(errno),
                   printable_name(mouse->file.string()), "reconnect the SpaceMouse"};
    }
    info_.name = mouse->name;
    try {
      reader_ = std::thread([this] { read_loop(); });
    } catch (const std::system_error& error) {
      ::close(file_);
      file_ = -1;
      return Error{ErrorKind::kUnavailable, std::string("cannot start a thread: ") + error.what(),
                   "spacemouse", "close other programs, or raise the process limit (ulimit -u)"};
    }
    return {};
  }

  void run(ServoFunction& servo, ServoClock& clock) {
    DeviceCommand none;
    std::int64_t last_ns = monotonic_ns();
    while (clock.wait()) {
      const std::int64_t now_ns = monotonic_ns();
      const double passed_s = std::min(1e-9 * static_cast<double>(now_ns - last_ns), kMaxStep_s);
      last_ns = now_ns;
      advance_tip(passed_s, now_ns);
      servo.update({&sample_, 1}, {&none, 1});
    }
  }

  std::optional<Error> failure() const {
    if (!lost_.load()) return std::nullopt;
    return Error{ErrorKind::kUnavailable, "the SpaceMouse was disconnected", info_.name,
                 "reconnect or charge it: the session resumes by itself"};
  }

 private:
  // ---- the servo's thread
  void advance_tip(double passed_s, std::int64_t now_ns) {
    sample_.fault = lost_.load();
    if (sample_.fault) return;
    sample_.taken_ns = now_ns;
    sample_.buttons = buttons_.load();
    const bool rests =
        is_relative_.load() && now_ns - last_event_ns_.load() > std::llround(kSilentIsRest_s * 1e9);
    Eigen::Vector3d displacement = Eigen::Vector3d::Zero(), turn = Eigen::Vector3d::Zero();
    for (int i = 0; i < 3 && !rests; ++i) {
      displacement[i] =
          speed_of(deflection_[static_cast<std::size_t>(i)].load()) * settings_.speed_mm_s * passed_s;
      turn[i] =
          speed_of(deflection_[static_cast<std::size_t>(i + 3)].load()) * settings_.turning_rad_s * passed_s;
    }
    for (int i = 0; i < 3; ++i)
      sample_.tip[i] = std::clamp(sample_.tip[i] + displacement[i], -kHalfReach_mm, kHalfReach_mm);
    if (const double angle = turn.norm(); angle > 0)
      sample_.R_DeviceTool =
          (Eigen::Quaterniond(Eigen::AngleAxisd(angle, turn / angle)) * sample_.R_DeviceTool).normalized();
  }

  // ---- the reader's thread
  void read_loop() {
    while (!end_.load()) {
      if (file_ < 0) {
        std::this_thread::sleep_for(kFindEvery);
        if (const auto mouse = choose_mouse(settings_))
          file_ = ::open(mouse->file.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
        if (file_ >= 0) lost_.store(false);
        continue;
      }
      pollfd waiting{file_, POLLIN, 0};
      if (::poll(&waiting, 1, kPoll_ms) <= 0) continue;
      read_events();
    }
  }

  void read_events() {
    std::array<input_event, 64> events;
    const ssize_t received = ::read(file_, events.data(), sizeof events);
    if (received < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (received <= 0 || static_cast<std::size_t>(received) % sizeof(input_event) != 0) return lose();
    for (std::size_t n = 0; n < static_cast<std::size_t>(received) / sizeof(input_event); ++n)
      take(events[n]);
  }

  void take(const input_event& event) {
    // the kernel's buffer overflowed: a lost release would keep the tip moving
    if (event.type == EV_SYN && event.code == SYN_DROPPED) {
      clear_input();
      is_dropped_ = true;
    }
    if (event.type == EV_SYN && event.code == SYN_REPORT) is_dropped_ = false;
    if (is_dropped_) return;
    if (event.type == EV_KEY && event.code >= BTN_0 && event.code < BTN_0 + 32) {
      const std::uint32_t bit = 1u << (event.code - BTN_0);
      buttons_.store(event.value != 0 ? buttons_.load() | bit : buttons_.load() & ~bit);
    }
    if (event.type != EV_REL && event.type != EV_ABS) return;
    const auto axis = axis_of(event.code);
    if (!axis) return;
    is_relative_.store(event.type == EV_REL);
    last_event_ns_.store(monotonic_ns());
    deflection_[axis->ours].store(axis->sign * std::clamp(event.value / kMaxDeflection, -1.0, 1.0));
  }

  void clear_input() {
    for (auto& axis : deflection_) axis.store(0);
    buttons_.store(0);
  }

  void lose() {
    lost_.store(true);
    clear_input();
    is_dropped_ = false;
    ::close(file_);
    file_ = -1;
  }

  const SpaceMouseSettings settings_;
  DeviceInfo info_;
  DeviceSample sample_;
  // reader's thread, once it runs
  int file_ = -1;
  bool is_dropped_ = false;  // events are ignored until the next report
  std::array<std::atomic<double>, 6> deflection_{};
  std::atomic<std::uint32_t> buttons_{0};
  std::atomic<std::int64_t> last_event_ns_{0};
  std::atomic<bool> is_relative_{false}, lost_{false}, end_{false};
  std::thread reader_;
};

SpaceMouseDriver::SpaceMouseDriver(const SpaceMouseSettings& settings)
    : core_(std::make_unique<Core>(settings)) {}
SpaceMouseDriver::~SpaceMouseDriver() = default;

std::span<const DeviceInfo> SpaceMouseDriver::devices() const {
  return core_->devices();
}

Result<void> SpaceMouseDriver::open(bool /*may_move*/) {
  return core_->open();
}

void SpaceMouseDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  core_->run(servo, clock);
}

std::optional<Error> SpaceMouseDriver::failure() const {
  return core_->failure();
}

DeviceVendor spacemouse_vendor(const SpaceMouseSettings& settings) {
  const auto detect = [settings] {
    DeviceReport report;
    const auto mouse = choose_mouse(settings);
    if (!mouse) {
      report.checks.push_back({"SpaceMouse", false, mouse.error().what, mouse.error().remedy});
      return report;
    }
    const std::string state = mouse->may_read ? "ready" : access_denied(*mouse).what;
    report.connected.push_back({mouse->name, state});
    report.checks.push_back({mouse->name, mouse->may_read, state, mouse->may_read ? "" : udev_remedy()});
    return report;
  };
  return {"spacemouse", "3Dconnexion SpaceMouse: moves and turns the tip, without force",
          [settings] { return std::make_unique<SpaceMouseDriver>(settings); }, detect};
}

}  // namespace palpate
