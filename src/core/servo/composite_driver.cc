#include "palpate/servo/composite_driver.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <system_error>
#include <thread>

#include "palpate/base/clock.h"
#include "palpate/base/mailbox.h"
#include "palpate/device/bounds.h"
#include "palpate/servo/realtime.h"
#include "servo/late_ticks.h"
#include "servo/pacer.h"

namespace palpate {
namespace {

constexpr auto kFirstStatePatience = std::chrono::seconds(1);
constexpr auto kFirstStatePoll = std::chrono::milliseconds(1);

// Update rate of a device; for one that does not state its rate, the lowest rate assumed of any device.
// @param pulled_hz  rate of pulled devices, which the loop determines
double update_rate_hz(const DeviceInfo& info, double pulled_hz) {
  if (info.drive == DeviceInfo::Drive::kPulled) return pulled_hz;
  return info.rate_hz && *info.rate_hz > 0 ? *info.rate_hz : ConservativeDevice{}.rate_hz;
}

}  // namespace

/// A driver in a thread of its own: the function that it calls, and the clock that it may wait for.
class CompositeDriver::Follower final : public ServoFunction, public ServoClock {
 public:
  Follower(const Part& part, const DeviceInfo& info, const CompositeDriverSettings& settings)
      : part_(part),
        name_(info.name),
        calls_back_(info.drive == DeviceInfo::Drive::kCallback),
        settings_(settings),
        period_ns_(std::llround(1e9 / *info.rate_hz)),
        pacer_(*info.rate_hz, 0, stop_) {
    // the position is unknown until the first update
    for (DeviceSample& sample : latest_.samples) sample.tip = Point<Device>(kNoValue, kNoValue, kNoValue);
  }
  ~Follower() override { end(); }

  void begin() noexcept {
    try {
      thread_ = std::thread([this] { follow(); });
      late_ticks_.begin(settings_.servo_cpu);
    } catch (const std::system_error&) {
      failed_.store(!thread_.joinable());
    }
  }
  void end() noexcept {
    stop_.store(true);
    if (thread_.joinable()) thread_.join();
    late_ticks_.end();
  }
  const Part& part() const { return part_; }
  /// Whether the driver has given up, or no thread could be created.
  bool has_failed() const { return failed_.load(); }
  bool has_state() const { return updates_.load() > 0 || has_failed(); }
  TickingThread ticking() const {
    return {name_, late_ticks_.scheduler(), updates_.load(), late_ticks_.counts()};
  }

  // ---- the thread of the tick
  /// Copies the newest sample of each of its devices to `samples`; sets their fault if the driver has given
  /// up.
  void read_state(std::span<DeviceSample> samples) noexcept {
    states_.take(latest_);
    for (std::size_t d = 0; d < part_.count; ++d) {
      samples[d] = latest_.samples[d];
      samples[d].fault = samples[d].fault || has_failed();
    }
  }
  /// Posts the commands, which the follower's next update returns to its driver.
  void post_commands(std::span<const DeviceCommand> commands, std::int64_t now_ns) noexcept {
    std::copy_n(commands.begin(), part_.count, posted_.commands.begin());
    posted_.at_ns = now_ns;
    commands_.post(posted_);
  }

  // ---- the follower's thread, or its vendor's
  bool wait() noexcept override { return pacer_.wait(); }
  bool stopped() const noexcept override { return stop_.load(std::memory_order_relaxed); }
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    PALPATE_CHECK(samples.size() == part_.count && commands.size() == part_.count);
    late_ticks_.tick_here();
    const std::int64_t now_ns = monotonic_ns();
    std::copy(samples.begin(), samples.end(), samples_.samples.begin());
    states_.post(samples_);
    commands_.take(latest_commands_);
    const bool fresh =
        latest_commands_.at_ns != 0 && now_ns - latest_commands_.at_ns <= std::llround(kOldCommand_s * 1e9);
    for (std::size_t d = 0; d < part_.count; ++d)
      commands[d] = fresh ? latest_commands_.commands[d] : DeviceCommand{};

    const std::int64_t late_ns = last_ns_ == 0 ? 0 : now_ns - last_ns_ - period_ns_;
    last_ns_ = now_ns;
    if (late_ns > period_ns_ / 2) late_ticks_.add(late_ns, 1);
    updates_.store(updates_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }

 private:
  struct Samples {
    std::array<DeviceSample, kMaxDevices> samples{};
  };
  struct Commands {
    std::array<DeviceCommand, kMaxDevices> commands{};
    std::int64_t at_ns = 0;  // 0: none yet
  };

  void follow() {
    exclude_cpu(settings_.servo_cpu);
    RealtimeRequest request;
    request.fifo = settings_.realtime && !calls_back_;
    request.lock_memory = settings_.realtime;
    request.priorities_above = 1;
    request.name = "palpate-follow";
    make_this_thread_realtime(request);
    part_.driver->run(*this, *this);
    if (!stopped()) failed_.store(true);
  }

  const Part part_;
  const std::string name_;
  const bool calls_back_;
  const CompositeDriverSettings settings_;
  const std::int64_t period_ns_;
  std::atomic<bool> stop_{false}, failed_{false};
  Pacer pacer_;
  Mailbox<Samples> states_;
  Mailbox<Commands> commands_;
  // owned by the thread of the tick
  Samples latest_;
  Commands posted_;
  // owned by the follower's thread
  Samples samples_;
  Commands latest_commands_;
  std::int64_t last_ns_ = 0;
  std::atomic<std::uint64_t> updates_{0};
  LateTicks late_ticks_;
  std::thread thread_;
};

/// Function that the owner's driver calls: combines its samples with those of all followers and runs one
/// tick.
class CompositeDriver::Gatherer final : public ServoFunction {
 public:
  Gatherer(ServoFunction& servo, const Part& owner, std::size_t devices,
           const std::vector<std::unique_ptr<Follower>>& followers)
      : servo_(servo), owner_(owner), devices_(devices), followers_(followers) {}
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    PALPATE_CHECK(samples.size() == owner_.count && commands.size() == owner_.count);
    std::ranges::copy(samples, samples_.begin() + static_cast<std::ptrdiff_t>(owner_.first));
    for (const auto& follower : followers_)
      follower->read_state(std::span(samples_).subspan(follower->part().first));
    servo_.update(std::span(samples_).first(devices_), std::span(commands_).first(devices_));
    std::ranges::copy(std::span(commands_).subspan(owner_.first, owner_.count), commands.begin());
    const std::int64_t now_ns = monotonic_ns();
    for (const auto& follower : followers_)
      follower->post_commands(std::span(commands_).subspan(follower->part().first), now_ns);
  }

 private:
  ServoFunction& servo_;
  const Part owner_;
  const std::size_t devices_;
  const std::vector<std::unique_ptr<Follower>>& followers_;
  std::array<DeviceSample, kMaxDevices> samples_{};
  std::array<DeviceCommand, kMaxDevices> commands_{};
};

CompositeDriver::CompositeDriver(std::vector<DeviceDriver*> drivers, const CompositeDriverSettings& settings)
    : drivers_(std::move(drivers)), settings_(settings) {
  PALPATE_CHECK(!drivers_.empty());
  for (const DeviceDriver* driver : drivers_) PALPATE_CHECK(driver->halt_fd() < 0);
  arrange();
}

CompositeDriver::~CompositeDriver() = default;

std::span<const DeviceInfo> CompositeDriver::devices() const {
  return infos_;
}

std::size_t CompositeDriver::clock_owner() const {
  return parts_[owner_].first + parts_[owner_].driver->clock_owner();
}

// collects all devices, selects the clock's owner, and adds the delay of following to the others
void CompositeDriver::arrange() {
  parts_.clear();
  infos_.clear();
  for (DeviceDriver* driver : drivers_) {
    const auto devices = driver->devices();
    parts_.push_back({driver, infos_.size(), devices.size()});
    infos_.insert(infos_.end(), devices.begin(), devices.end());
  }
  PALPATE_CHECK(infos_.size() <= static_cast<std::size_t>(kMaxDevices));
  // some drivers know their devices only after open()
  if (std::ranges::any_of(parts_, [](const Part& part) { return part.count == 0; })) return;

  const auto clock_of = [&](const Part& part) -> const DeviceInfo& {
    return infos_[part.first + part.driver->clock_owner()];
  };
  const auto rank = [&](const Part& part) {
    const DeviceInfo& info = clock_of(part);
    // a device without a force limit exerts none
    const int priority = !info.simulated ? 2 : info.peak_force_N ? 1 : 0;
    return std::pair(priority, update_rate_hz(info, settings_.rate_hz));
  };
  owner_ = 0;
  for (std::size_t p = 1; p < parts_.size(); ++p)
    if (rank(parts_[p]) > rank(parts_[owner_])) owner_ = p;

  const double owner_s = 1 / update_rate_hz(clock_of(parts_[owner_]), settings_.rate_hz);
  for (const Part& part : parts_) {
    if (&part == &parts_[owner_]) continue;
    const double rate_hz = update_rate_hz(clock_of(part), settings_.rate_hz);
    for (DeviceInfo& info : std::span(infos_).subspan(part.first, part.count)) {
      info.rate_hz = rate_hz;
      info.delay_s = conservative_delay_s(info) + 1 / rate_hz + owner_s;
      if (info.simulated) continue;
      // an invalid stiffness stays invalid
      const double conservative_N_per_mm = conservative_bounds(info).stiffness_N_per_mm;
      if (!info.stiffness_N_per_mm || *info.stiffness_N_per_mm > conservative_N_per_mm)
        info.stiffness_N_per_mm = conservative_N_per_mm;
    }
  }
  make_followers();
}

void CompositeDriver::make_followers() {
  // the lock is only ever held briefly, and never by a tick
  const std::lock_guard lock(mutex_);
  followers_.clear();
  for (std::size_t p = 0; p < parts_.size(); ++p) {
    if (p == owner_) continue;
    const DeviceInfo& info = infos_[parts_[p].first + parts_[p].driver->clock_owner()];
    followers_.push_back(std::make_unique<Follower>(parts_[p], info, settings_));
  }
}

Result<void> CompositeDriver::open(bool may_move) {
  for (const Part& part : parts_)
    if (auto opened = part.driver->open(may_move); !opened) return opened.error();
  arrange();
  return {};
}

void CompositeDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  // recreated, so that every run starts from the same state
  make_followers();
  for (const auto& follower : followers_) follower->begin();
  // A tip whose position is unknown at first would appear as a jump, so wait for the first states.
  const auto has_state = [](const auto& follower) { return follower->has_state(); };
  const auto until = std::chrono::steady_clock::now() + kFirstStatePatience;
  while (!clock.stopped() && !std::ranges::all_of(followers_, has_state) &&
         std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(kFirstStatePoll);

  Gatherer gatherer(servo, parts_[owner_], infos_.size(), followers_);
  parts_[owner_].driver->run(gatherer, clock);
  for (const auto& follower : followers_) follower->end();
}

void CompositeDriver::halt() noexcept {
  for (const Part& part : parts_) part.driver->halt();
}

void CompositeDriver::resume(std::uint64_t newest) noexcept {
  for (const Part& part : parts_) part.driver->resume(newest);
}

std::optional<Error> CompositeDriver::failure() const {
  for (const Part& part : parts_)
    if (auto failure = part.driver->failure()) return failure;
  const std::lock_guard lock(mutex_);
  for (const auto& follower : followers_)
    if (follower->has_failed())
      return Error{ErrorKind::kUnavailable, "its driver has failed, and it gets no force",
                   infos_[follower->part().first].name,
                   "check its connection and power, then restart the session"};
  return std::nullopt;
}

std::vector<TickingThread> CompositeDriver::followers() const {
  const std::lock_guard lock(mutex_);
  std::vector<TickingThread> threads;
  for (const auto& follower : followers_) threads.push_back(follower->ticking());
  return threads;
}

}  // namespace palpate
