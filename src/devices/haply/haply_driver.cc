#include "palpate/haply/haply_driver.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <system_error>
#include <thread>
#include <variant>

#include "haply/sender_pace.h"
#include "haply/service_search.h"
#include "palpate/base/clock.h"
#include "palpate/device/telemetry.h"

namespace palpate {
namespace {

using haply::Connection;
using haply::Failure;
using haply::Found;
using haply::Inverse3;
using haply::NotFound;
using haply::RequestWriter;
using haply::SenderPace;
using haply::State;

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
    search_requested_.store(false);
    auto result = haply::connect_to_service(settings_);
    if (const auto* none = std::get_if<NotFound>(&result)) return none->error;
    Found* const found = std::get_if<Found>(&result);
    if (found->inventory.devices.empty())
      return Error{ErrorKind::kUnavailable, "the Inverse Service detects no Inverse3", "haply",
                   "connect it by USB, power it, and check that its light is on"};
    for (const Inverse3& device : found->inventory.devices) {
      if (device.status.in_use.value_or(false))
        return Error{ErrorKind::kUnavailable, haply::name_of(device) + " is in use by another program",
                     "haply", "close that program"};
      if (const Failure failure = haply::failure_of(device.status); failure != Failure::kNone)
        return haply::error_for(failure, haply::name_of(device));
    }
    count_ = std::min<std::size_t>(found->inventory.devices.size(), kMaxDevices);
    for (std::size_t d = 0; d < count_; ++d) ids_.push_back(found->inventory.devices[d].id);
    const State inventory = found->inventory;
    reply_timeout_s_ = kOpenPatience_s;
    adopt(std::move(*found));
    const auto round_trip_s = measure();
    if (!round_trip_s) return haply::error_for(failure_.load(), "haply");
    describe(inventory, 1 / std::max(*round_trip_s, 1 / settings_.max_rate_hz));
    try {
      finder_ = std::thread([this] { run_finder(); });
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
    return haply::error_for(now, infos_.empty() ? "haply" : infos_.front().name);
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
        pace_.assume_queued(checked_ns);
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
    const Failure failure = haply::failure_of(device->status);
    sample.fault = failure != Failure::kNone;
    return failure;
  }

  // always returns false, for exchange()
  bool lose(Failure why) {
    note(why);
    connection_.reset();
    for (std::size_t d = 0; d < count_; ++d) samples_[d].fault = true;
    search_requested_.store(true);
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
      info.name = haply::name_of(inventory.devices[d]);
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
  void run_finder() {
    auto next = std::chrono::steady_clock::now();
    while (!end_.load()) {
      std::this_thread::sleep_for(kFindPoll);
      if (!search_requested_.load()) listen_to_events();
      if (!search_requested_.load() || std::chrono::steady_clock::now() < next) continue;
      next = std::chrono::steady_clock::now() + kFindEvery;
      auto found = haply::connect_to_service(settings_);
      if (const auto* none = std::get_if<NotFound>(&found)) {
        note(none->why);
        continue;
      }
      search_requested_.store(false);
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

  std::atomic<bool> halted_{false}, search_requested_{false}, end_{false};
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

}  // namespace palpate
