#include "palpate/haply/haply_driver.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <system_error>
#include <thread>
#include <variant>

#include "haply/connection.h"
#include "haply/messages.h"
#include "palpate/base/clock.h"
#include "palpate/device/telemetry.h"

namespace palpate {
namespace {

using haply::Connection;
using haply::Inverse3;
using haply::RequestWriter;
using haply::ServiceVersion;
using haply::State;
using haply::Status;

constexpr auto kInventoryPatience_ns = std::int64_t{2'000'000'000};
// longer at the start of a session, when the machine is busy
constexpr double kOpenPatience_s = 5;
// number of round trips from which the rate is estimated
constexpr int kMeasured = 40;
// interval of the search for a lost service, and of polling whether a search is wanted
constexpr auto kFindEvery = std::chrono::milliseconds(100), kFindPoll = std::chrono::milliseconds(5);
// period of the servo while there is no connection
constexpr auto kLostPeriod = std::chrono::milliseconds(1);
constexpr std::int64_t kLastZero_ns = 20'000'000;
// number of consecutive invalid replies after which the connection is replaced
constexpr int kMaxBroken = 20;
// maximum number of events processed before other work
constexpr int kMaxEvents = 100;
// maximum number of unsolicited states read before a request, and maximum time for it
constexpr int kMaxDrained = 256;
constexpr std::int64_t kDraining_ns = 500'000;
// half edge of the largest cube in the reachable ball of 100 mm radius
constexpr double kHalfReach_mm = 57.7;

}  // namespace

namespace haply {

/// Reasons for the absence of force, the most serious first.
enum class Failure : std::uint8_t {
  kNone,
  kLost,          ///< The connection was closed
  kNoService,     ///< The connection was closed, and no service answers
  kOtherVersion,  ///< The service that answers has an unsupported version
  kSilent,        ///< Requests are not answered
  kBroken,        ///< Replies are invalid
  kBehind,        ///< States may come from a queue (SenderPace), so that their age is unknown
  kBrake,         ///< A brake or a disconnection was reported recently
  kGone,          ///< A device is no longer in the service's list
  kNoPower,
  kNotCalibrated,
  kNotReady,
};

/// A connection, and the service's version and inventory.
struct Found {
  ServiceVersion version;
  std::unique_ptr<Connection> connection;
  State inventory;
};

}  // namespace haply

namespace {

using haply::Failure;
using haply::Found;

// trouble reported by a device; anything not reported counts as fine
Failure failure_of(const Status& status) {
  if (!status.power_supply.value_or(true)) return Failure::kNoPower;
  if (!status.calibrated.value_or(true)) return Failure::kNotCalibrated;
  if (!status.ready.value_or(true) || !status.started.value_or(true)) return Failure::kNotReady;
  return Failure::kNone;
}

struct Words {
  const char *what, *remedy;
};
Words words_for(Failure failure) {
  switch (failure) {
    case Failure::kLost:
      return {"the Inverse Service has closed the connection",
              "no action is needed: the session resumes when it is connected again"};
    case Failure::kNoService:
      return {"the Inverse Service does not answer", "restart it: the session then resumes by itself"};
    case Failure::kOtherVersion:
      return {"the version of the Inverse Service is not supported",
              "start version 3.0, 3.1, or 3.5 or later: the session then resumes by itself"};
    case Failure::kSilent:
      return {"the Inverse Service sends no states",
              "is the machine overloaded? If this persists, restart the service"};
    case Failure::kBroken:
      return {"the Inverse Service sends messages that are not device states",
              "does another program listen on its port? Restart the service"};
    case Failure::kBehind:
      return {"the Inverse Service sends more states than usual, or stalled: states may be outdated",
              "wait a moment; if this persists, close other programs that request states, or restart it"};
    case Failure::kBrake:
      return {"the device's brake is on, or it was unplugged",
              "release the brake and check the USB cable: the session resumes a second later"};
    case Failure::kGone:
      return {"the service has lost the device", "check its USB cable, and reconnect it"};
    case Failure::kNoPower:
      return {"the device has no power", "connect its power supply"};
    case Failure::kNotCalibrated:
      return {"the device is not calibrated",
              "move its arm as described in Haply's manual until it is calibrated"};
    case Failure::kNotReady:
      return {"the device is not ready", "wait until its light shows that it is ready, or reconnect it"};
    case Failure::kNone:
      break;
  }
  return {"", ""};
}

Error error_for(Failure failure, const std::string& where) {
  const Words words = words_for(failure);
  return {ErrorKind::kUnavailable, words.what, where, words.remedy};
}

std::string name_of(const Inverse3& device) {
  return "Inverse3 " + device.id;
}

std::string state_in_words(const Status& status) {
  if (status.in_use.value_or(false)) return "in use by another program";
  const Failure failure = failure_of(status);
  return failure == Failure::kNone ? "ready" : words_for(failure).what;
}

/// Reason of a failed search: kNoService, kOtherVersion, kSilent or kBroken.
struct NotFound {
  Failure why = Failure::kNoService;
  Error error;
};

std::variant<Found, NotFound> find(const HaplySettings& settings) {
  const auto version = haply::find_service(settings);
  if (!version) return NotFound{Failure::kNoService, version.error()};
  if (!haply::force_key(*version)) {
    Error other = error_for(Failure::kOtherVersion, "haply");
    other.what += ": " + std::to_string(version->major) + "." + std::to_string(version->minor);
    return NotFound{Failure::kOtherVersion, other};
  }
  auto connection = Connection::open(settings, settings.port);
  if (!connection) return NotFound{Failure::kNoService, connection.error()};
  std::string text;
  const auto received = (*connection)->receive(text, monotonic_ns() + kInventoryPatience_ns);
  if (received != Connection::Received::kMessage)
    return NotFound{Failure::kSilent, error_for(Failure::kSilent, "haply")};
  auto inventory = haply::parse_state(text);
  if (!inventory) return NotFound{Failure::kBroken, error_for(Failure::kBroken, "haply")};
  return Found{*version, *std::move(connection), *std::move(inventory)};
}

}  // namespace

/// Decides whether a sender's states may come from a queue, by the number of unsolicited states. They may
/// after a stall, and when more arrive than the known pace explains, until a time window contains no more
/// than that. A pace that is sustained becomes the known pace.
class SenderPace {
 public:
  explicit SenderPace(std::int64_t now_ns = 0) : observed_ns_(now_ns), started_ns_(now_ns) {}

  /// @param count  number of unsolicited states since the last call
  void observe(int count, std::int64_t now_ns) {
    const bool stalled = now_ns - observed_ns_ > kStall_ns;
    observed_ns_ = now_ns;
    if (stalled) return doubt(now_ns);
    count_ += count;
    const double window_s = static_cast<double>(now_ns - started_ns_) * 1e-9;
    const bool explained = count_ <= kSurplus + kAbove * pace_hz_ * window_s;
    if (!queued_ && !explained) return doubt(now_ns);
    if (window_s < kWindow_s) return;
    const double hz = count_ / window_s;
    steady_windows_ = std::abs(hz - before_hz_) * window_s <= kSurplus + kSteady * before_hz_ * window_s
                          ? steady_windows_ + 1
                          : 0;
    if (!queued_)
      pace_hz_ += kFollowed * (hz - pace_hz_);
    else if (steady_windows_ >= kSteadyWindows)
      pace_hz_ = hz;
    if (explained || steady_windows_ >= kSteadyWindows) queued_ = false;
    before_hz_ = hz;
    started_ns_ = now_ns;
    count_ = 0;
  }
  /// States may be queued from now on.
  void doubt(std::int64_t now_ns) {
    if (!queued_) steady_windows_ = 0;
    queued_ = true;
    observed_ns_ = started_ns_ = now_ns;
    count_ = 0;
  }
  bool may_be_queued() const { return queued_; }

 private:
  static constexpr std::int64_t kStall_ns = 10'000'000;
  static constexpr double kWindow_s = 0.02;
  // tolerance in states per window, and factor relative to the known pace; maximum difference of successive
  // windows of a steady pace
  static constexpr double kSurplus = 4, kAbove = 1.5, kSteady = 0.25;
  // low-pass coefficient of the known pace per window; number of steady windows after which a new pace is
  // adopted at once
  static constexpr double kFollowed = 0.1;
  static constexpr int kSteadyWindows = 25;

  bool queued_ = false;
  std::int64_t observed_ns_, started_ns_;
  int count_ = 0, steady_windows_ = 0;
  double pace_hz_ = 0, before_hz_ = 0;
};

/// Members are grouped by the thread that uses them. The servo's thread is the caller of run().
class HaplyDriver::Core {
 public:
  explicit Core(const HaplySettings& settings) : settings_(settings) {}
  ~Core() {
    end_.store(true);
    if (finder_.joinable()) finder_.join();
    delete found_.exchange(nullptr);
  }

  std::span<const DeviceInfo> devices() const { return infos_; }

  Result<void> open() {
    if (finder_.joinable()) return {};
    ids_.clear();
    wanted_.store(false);
    auto result = find(settings_);
    if (const auto* none = std::get_if<NotFound>(&result)) return none->error;
    Found* const found = std::get_if<Found>(&result);
    if (found->inventory.devices.empty())
      return Error{ErrorKind::kUnavailable, "the Inverse Service detects no Inverse3", "haply",
                   "connect it by USB, power it, and check that its light is on"};
    for (const Inverse3& device : found->inventory.devices) {
      if (device.status.in_use.value_or(false))
        return Error{ErrorKind::kUnavailable, name_of(device) + " is in use by another program", "haply",
                     "close that program"};
      if (const Failure failure = failure_of(device.status); failure != Failure::kNone)
        return error_for(failure, name_of(device));
    }
    count_ = std::min<std::size_t>(found->inventory.devices.size(), kMaxDevices);
    for (std::size_t d = 0; d < count_; ++d) ids_.push_back(found->inventory.devices[d].id);
    const State inventory = found->inventory;
    reply_timeout_s_ = kOpenPatience_s;
    adopt(std::move(*found));
    const auto round_trip_s = measure();
    if (!round_trip_s) return error_for(failure_.load(), "haply");
    describe(inventory, 1 / std::max(*round_trip_s, 1 / settings_.max_rate_hz));
    try {
      finder_ = std::thread([this] { detect_service(); });
    } catch (const std::system_error& error) {
      return Error{ErrorKind::kUnavailable, std::string("cannot start a thread: ") + error.what(), "haply",
                   "close other programs, or raise the process limit (ulimit -u)"};
    }
    return {};
  }

  void run(ServoFunction& servo, ServoClock& clock) {
    commands_ = {};
    reply_timeout_s_ = kAbandoned_s;
    last_message_ns_ = monotonic_ns();
    const std::int64_t started_ns = monotonic_ns();
    bool reported = false;
    while (!clock.stopped()) {
      reported = (connection_ ? exchange() : wait_for_service()) || reported;
      // the initial tip positions come from open(); after kSilence_s without a sample the servo runs with
      // stale ones
      if (reported || monotonic_ns() - started_ns > to_ns(kSilence_s))
        servo.update(std::span(samples_).first(count_), std::span(commands_).first(count_));
    }
    send_final_zero();
  }

  void halt() { halted_.store(true); }
  void resume() { halted_.store(false); }
  std::optional<Error> failure() const {
    const Failure now = failure_.load();
    if (now == Failure::kNone) return std::nullopt;
    return error_for(now, infos_.empty() ? "haply" : infos_.front().name);
  }

 private:
  // ---- the servo's thread, and before run() the thread that opens

  // One exchange, or the part of it that fits into the timeouts. Returns true if the samples are new.
  bool exchange() {
    if (outstanding_ == 0) {
      std::this_thread::sleep_for(std::chrono::nanoseconds(
          std::max<std::int64_t>(0, sent_ns_ + to_ns(1 / settings_.max_rate_hz) - monotonic_ns())));
      if (!drain()) return lose(Failure::kLost);
      if (!send(halted_.load() || pace_.may_be_queued() ? zeros_ : commands_)) return lose(Failure::kLost);
    } else if (!zero_requested_ && monotonic_ns() - sent_ns_ > to_ns(kSilence_s)) {
      // a service that does not reply may still read
      zero_requested_ = true;
      note(Failure::kSilent);
      if (!send(zeros_)) return lose(Failure::kLost);
    }
    switch (connection_->receive(text_, monotonic_ns() + to_ns(kTimeout_s))) {
      case Connection::Received::kMessage:
        return read_message();
      case Connection::Received::kNothing:
        return monotonic_ns() - last_message_ns_ > to_ns(reply_timeout_s_) ? lose(Failure::kSilent) : false;
      case Connection::Received::kLost:
        break;
    }
    return lose(Failure::kLost);
  }

  // Reads unsolicited states, so that the next state was sampled afterwards. A service that sends more states
  // than there are requests would otherwise fill a queue, and the force would follow its oldest entry.
  // Returns false if the connection is lost.
  bool drain() {
    const std::int64_t started_ns = monotonic_ns();
    for (int count = 0;; ++count) {
      const std::int64_t checked_ns = monotonic_ns();
      if (count == kMaxDrained || checked_ns > started_ns + kDraining_ns) {
        pace_.doubt(checked_ns);
        return true;
      }
      switch (connection_->receive(text_, checked_ns)) {
        case Connection::Received::kLost:
          return false;
        case Connection::Received::kMessage:
          last_message_ns_ = checked_ns;
          break;
        case Connection::Received::kNothing:
          drained_ns_ = checked_ns;
          pace_.observe(count, checked_ns);
          return true;
      }
    }
  }

  bool send(const std::array<DeviceCommand, kMaxDevices>& commands) {
    const std::string& request = writer_->write(first_, std::span(commands).first(count_));
    sent_ns_ = monotonic_ns();
    first_ = false;
    ++outstanding_;
    return connection_->send(request);
  }

  bool read_message() {
    last_message_ns_ = monotonic_ns();
    outstanding_ = std::max(0, outstanding_ - 1);
    const auto state = haply::parse_state(text_);
    if (!state) {
      for (std::size_t d = 0; d < count_; ++d) samples_[d].fault = true;
      if (++broken_ >= kMaxBroken) return lose(Failure::kBroken);
      note(Failure::kBroken);
      return true;
    }
    broken_ = 0;
    // with several pending requests only the reply to the last one is current
    if (outstanding_ > 0) return false;
    zero_requested_ = false;
    const bool braked = last_message_ns_ < braked_until_ns_.load();
    const bool queued = pace_.may_be_queued();
    Failure worst = queued ? Failure::kBehind : braked ? Failure::kBrake : Failure::kNone;
    for (std::size_t d = 0; d < count_; ++d) {
      const Failure own = receive_state(*state, d);
      samples_[d].fault = samples_[d].fault || braked || queued;
      if (own != Failure::kNone && (worst == Failure::kNone || own < worst)) worst = own;
    }
    note(worst);
    return true;
  }

  // state of one device
  Failure receive_state(const State& state, std::size_t d) {
    DeviceSample& sample = samples_[d];
    const auto device = std::ranges::find(state.devices, ids_[d], &Inverse3::id);
    sample.fault = true;
    if (device == state.devices.end()) return Failure::kGone;
    // a state without a position is not an update
    if (!device->tip_mm) return Failure::kBroken;
    sample.tip = *device->tip_mm;
    sample.velocity_mm_s = device->velocity_mm_s;
    // the state is a reply to the request, or was sent unsolicited after the queue had been drained
    sample.taken_ns = drained_ns_;
    if (d < state.grips.size()) {
      sample.R_DeviceTool = state.grips[d].orientation;
      sample.buttons = state.grips[d].buttons;
    }
    const Failure failure = failure_of(device->status);
    sample.fault = failure != Failure::kNone;
    return failure;
  }

  // always returns false, for exchange()
  bool lose(Failure why) {
    note(why);
    connection_.reset();
    for (std::size_t d = 0; d < count_; ++d) samples_[d].fault = true;
    wanted_.store(true);
    return false;
  }

  bool wait_for_service() {
    if (const std::unique_ptr<Found> found{found_.exchange(nullptr)}) {
      adopt(std::move(*found));
      return false;
    }
    std::this_thread::sleep_for(kLostPeriod);
    return false;
  }

  void adopt(Found found) {
    connection_ = std::move(found.connection);
    writer_.emplace(ids_, haply::force_key(found.version));
    has_events_.store(haply::has_events(found.version));
    first_ = true;
    zero_requested_ = false;
    outstanding_ = broken_ = 0;
    last_message_ns_ = drained_ns_ = monotonic_ns();
    pace_ = SenderPace(last_message_ns_);
    // commands of the previous connection are obsolete
    commands_ = {};
  }

  void send_final_zero() {
    if (!connection_ || !send(zeros_)) return;
    const std::int64_t until_ns = monotonic_ns() + kLastZero_ns;
    while (outstanding_ > 0 && monotonic_ns() < until_ns) {
      const auto received = connection_->receive(text_, until_ns);
      if (received == Connection::Received::kLost) return;
      if (received == Connection::Received::kMessage) --outstanding_;
    }
  }

  // median of some round trips without force; empty: no reply
  std::optional<double> measure() {
    std::array<std::int64_t, kMeasured> took_ns{};
    for (std::int64_t& took : took_ns) {
      const std::int64_t started_ns = monotonic_ns();
      while (connection_ && !exchange()) {
      }
      if (!connection_) return std::nullopt;
      took = monotonic_ns() - started_ns;
    }
    std::ranges::nth_element(took_ns, took_ns.begin() + kMeasured / 2);
    return static_cast<double>(took_ns[kMeasured / 2]) * 1e-9;
  }

  void describe(const State& inventory, double rate_hz) {
    infos_.clear();
    for (std::size_t d = 0; d < count_; ++d) {
      const bool grip = d < inventory.grips.size();
      DeviceInfo info;
      info.name = name_of(inventory.devices[d]);
      info.drive = DeviceInfo::Drive::kExchange;
      info.peak_force_N = settings_.peak_force_N;
      info.rate_hz = rate_hz;
      info.degrees_of_freedom_in = grip ? 6 : 3;
      info.buttons = grip ? 3 : 0;
      info.R_WorldDevice = haply_axes();
      // rest position of the tip in the vendor's example: in front of the base and above it
      const Point<Device> centre(0, -120, 150);
      const Vector<Device> half(kHalfReach_mm, kHalfReach_mm, kHalfReach_mm);
      info.workspace = {centre - half, centre + half};
      infos_.push_back(info);
    }
  }

  // ---- any thread
  void note(Failure failure) { failure_.store(failure); }

  // ---- the finder's thread
  void detect_service() {
    auto next = std::chrono::steady_clock::now();
    while (!end_.load()) {
      std::this_thread::sleep_for(kFindPoll);
      if (!wanted_.load()) listen_to_events();
      if (!wanted_.load() || std::chrono::steady_clock::now() < next) continue;
      next = std::chrono::steady_clock::now() + kFindEvery;
      auto found = find(settings_);
      if (const auto* none = std::get_if<NotFound>(&found)) {
        note(none->why);
        continue;
      }
      wanted_.store(false);
      delete found_.exchange(new Found(std::move(std::get<Found>(found))));
    }
  }

  // processes all pending events, and connects if necessary, at the same interval as the search for a service
  void listen_to_events() {
    const auto now = std::chrono::steady_clock::now();
    if (!events_) {
      if (!has_events_.load() || now < next_events_) return;
      next_events_ = now + kFindEvery;
      auto events = Connection::open(settings_, settings_.events_port);
      if (!events) return;
      events_ = *std::move(events);
    }
    std::string text;
    for (int n = 0; n < kMaxEvents; ++n) {
      const auto received = events_->receive(text, monotonic_ns() + to_ns(1e-3));
      if (received == Connection::Received::kLost) events_.reset();
      if (received != Connection::Received::kMessage) return;
      if (haply::reports_brake(text)) braked_until_ns_.store(monotonic_ns() + to_ns(kBraked_s));
    }
  }

  const std::array<DeviceCommand, kMaxDevices> zeros_{};
  const HaplySettings settings_;
  std::vector<DeviceInfo> infos_;
  std::vector<std::string> ids_;
  std::size_t count_ = 0;

  std::unique_ptr<Connection> connection_;
  std::optional<RequestWriter> writer_;
  std::array<DeviceSample, kMaxDevices> samples_{};
  std::array<DeviceCommand, kMaxDevices> commands_{};
  std::string text_;
  bool first_ = true, zero_requested_ = false;
  int outstanding_ = 0, broken_ = 0;
  double reply_timeout_s_ = kAbandoned_s;
  std::int64_t sent_ns_ = 0, last_message_ns_ = 0, drained_ns_ = 0;
  SenderPace pace_;

  std::atomic<bool> halted_{false}, wanted_{false}, end_{false};
  std::atomic<Failure> failure_{Failure::kNone};
  std::atomic<Found*> found_{nullptr};
  std::atomic<bool> has_events_{false};
  std::atomic<std::int64_t> braked_until_ns_{0};
  // finder's thread
  std::unique_ptr<Connection> events_;
  std::chrono::steady_clock::time_point next_events_{};
  std::thread finder_;
};

HaplyDriver::HaplyDriver(const HaplySettings& settings) : core_(std::make_unique<Core>(settings)) {}
HaplyDriver::~HaplyDriver() = default;

std::span<const DeviceInfo> HaplyDriver::devices() const {
  return core_->devices();
}

Result<void> HaplyDriver::open(bool /*may_move*/) {
  return core_->open();
}

void HaplyDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  core_->run(servo, clock);
}

void HaplyDriver::halt() noexcept {
  core_->halt();
}

void HaplyDriver::resume(std::uint64_t /*newest*/) noexcept {
  core_->resume();
}

std::optional<Error> HaplyDriver::failure() const {
  return core_->failure();
}

namespace {

DeviceReport detect(const HaplySettings& settings) {
  DeviceReport report;
  const std::string endpoint = "Inverse Service at " + settings.host + ":" + std::to_string(settings.port);
  auto result = find(settings);
  if (const auto* none = std::get_if<NotFound>(&result)) {
    report.checks.push_back({endpoint, false, none->error.what, none->error.remedy});
    return report;
  }
  const Found* const found = std::get_if<Found>(&result);
  report.checks.push_back(
      {endpoint, true,
       "version " + std::to_string(found->version.major) + "." + std::to_string(found->version.minor), ""});
  if (found->inventory.devices.empty())
    report.checks.push_back({"Inverse3", false, "the service detects none",
                             "connect it by USB, power it, and check that its light is on"});
  for (const Inverse3& device : found->inventory.devices) {
    const Failure failure = failure_of(device.status);
    const bool in_use = device.status.in_use.value_or(false);
    report.connected.push_back({device.id, state_in_words(device.status)});
    report.checks.push_back({name_of(device), failure == Failure::kNone && !in_use,
                             state_in_words(device.status),
                             in_use ? "close the program that uses it" : words_for(failure).remedy});
  }
  return report;
}

}  // namespace

DeviceVendor haply_vendor(const HaplySettings& settings) {
  return {"haply", "Haply Inverse3, through the Inverse Service (3.0, 3.1, 3.5 on)",
          [settings] { return std::make_unique<HaplyDriver>(settings); },
          [settings] { return detect(settings); }};
}

}  // namespace palpate
