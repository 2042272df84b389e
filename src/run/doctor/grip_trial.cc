#include "palpate/doctor/grip_trial.h"

#include <time.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <system_error>
#include <thread>

#include "doctor/grip_trial_servo.h"
#include "palpate/base/clock.h"
#include "palpate/base/printable.h"
#include "palpate/servo/realtime.h"

namespace palpate {
namespace {

constexpr auto kPollInterval = std::chrono::milliseconds(1);
// transient errors at a driver's start may last this long
constexpr std::int64_t kMaxStartErrors_ns = 100'000'000;
// maximum time a driver takes to end
constexpr std::int64_t kMaxDriverEnd_ns = 5'000'000'000;
constexpr double kMaxSpring_N_per_mm = 5;

/// Clock with even ticks, which the waiting thread runs.
class EvenClock final : public ServoClock {
 public:
  explicit EvenClock(double rate_hz) : period_ns_(std::llround(1e9 / rate_hz)) {}
  bool wait() noexcept override {
    const std::int64_t now_ns = monotonic_ns();
    next_ns_ = std::max(next_ns_ + period_ns_, now_ns);
    const timespec until{next_ns_ / 1'000'000'000, next_ns_ % 1'000'000'000};
    ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
    return !stop_.load();
  }
  bool stopped() const noexcept override { return stop_.load(); }
  void stop() { stop_.store(true); }

 private:
  const std::int64_t period_ns_;
  std::int64_t next_ns_ = 0;
  std::atomic<bool> stop_{false};
};

Error error_of(GripTrial::EndReason why, const DeviceDriver& driver, const std::string& device) {
  const auto error = [&](const char* what, const char* remedy) {
    return Error{ErrorKind::kUnavailable, what, device, remedy};
  };
  using EndReason = GripTrial::EndReason;
  switch (why) {
    case EndReason::kMovedAway:
      return error("the tip was moved away", "hold it at one place, lightly, and try again");
    case EndReason::kTooFast:
      return error("the tip was too fast", "hold it a little more firmly, and try again");
    case EndReason::kStaleSample:
      return error("the device's states came too late", "run palpate doctor to check this computer");
    case EndReason::kBadTimestamps:
      return error("the timestamps of the device's states run backwards, or lie in the future",
                   "restart the vendor's service, or this computer");
    case EndReason::kOscillated:
      return error("it oscillated with the softest spring", "hold still, in free air, and try again");
    case EndReason::kNotReady:
      if (auto problems = driver.failure()) return *problems;
      return error("the device was not ready when it was armed", "check its indicator, and try again");
    case EndReason::kNotFinite:
      return error("the device reported an invalid position", "switch it off and on again");
    case EndReason::kLate:
      return error("a tick was too late, and the device was halted",
                   "run palpate doctor to check this computer");
    default:
      break;
  }
  if (auto problems = driver.failure()) return *problems;
  return error("the device has withheld its force", "check its indicator, and try again");
}

/// The watchdog. Returns false if interrupted.
bool watch(DeviceDriver& driver, GripTrial& trial, const std::atomic<bool>& removed, Heartbeat* heartbeat,
           const Progress& progress, const std::string& name) {
  const std::int64_t started_ns = monotonic_ns();
  while (trial.ended() == GripTrial::EndReason::kNone && !removed.load()) {
    std::this_thread::sleep_for(kPollInterval);
    const std::int64_t last_ns = trial.last_update_ns(), now_ns = monotonic_ns();
    if (heartbeat && last_ns != 0) {
      heartbeat->beat_ns.store(last_ns);
      heartbeat->checked_ns.store(now_ns);
    }
    const std::int64_t waits_ns = trial.begun() ? 0 : now_ns - started_ns;
    if (1e-9 * static_cast<double>(waits_ns) > GripTrial::kBegin_s ||
        (waits_ns > kMaxStartErrors_ns && driver.failure()))
      trial.end(GripTrial::EndReason::kNotReady);
    if (last_ns != 0 && now_ns - last_ns > GripTrial::kLate_ns) {
      driver.halt();
      trial.end(GripTrial::EndReason::kLate);
    }
    if (progress.stopped()) return false;
    progress.report("holding " + name, std::min(0.99, trial.progress()));
  }
  return true;
}

// Waits until the driver has ended. The heartbeat shows the supervisor that this process lives, but for a
// limited time: a driver that does not end still holds the device.
void await_end(const std::atomic<bool>& removed, Heartbeat* heartbeat) {
  if (!heartbeat) return;
  heartbeat->beat_ns.store(Heartbeat::kResting);
  for (const std::int64_t started_ns = monotonic_ns();
       !removed.load() && monotonic_ns() - started_ns < kMaxDriverEnd_ns;) {
    heartbeat->checked_ns.store(monotonic_ns());
    std::this_thread::sleep_for(kPollInterval);
  }
}

}  // namespace

Result<GripTrialFigures> run_grip_trial(DeviceDriver& driver, const GripTrialSettings& settings,
                                        const Progress& progress) {
  PALPATE_CHECK(settings.max_force_N > 0 && settings.max_force_N <= 1 && settings.rate_hz >= 250 &&
                settings.rate_hz <= 10000 && settings.first_N_per_mm > 0 && settings.growth > 1 &&
                settings.max_N_per_mm >= settings.first_N_per_mm &&
                settings.max_N_per_mm <= kMaxSpring_N_per_mm);
  if (auto opened = driver.open(false); !opened) return opened.error();
  const DeviceInfo info = driver.devices()[0];
  const double rate_hz =
      info.drive == DeviceInfo::Drive::kPulled ? settings.rate_hz : info.rate_hz.value_or(settings.rate_hz);
  GripTrial trial(settings, rate_hz, info.position_step_mm.value_or(0.06), monotonic_ns);
  EvenClock clock(settings.rate_hz);
  std::atomic<bool> removed{false};
  std::thread running;
  try {
    running = std::thread([&] {
      RealtimeRequest request;
      request.fifo = settings.realtime && info.drive != DeviceInfo::Drive::kCallback;
      request.lock_memory = settings.realtime;
      request.name = "palpate-hold";
      make_this_thread_realtime(request);
      driver.run(trial, clock);
      removed.store(true);
    });
  } catch (const std::system_error& error) {
    return Error{ErrorKind::kUnavailable, std::string("cannot start a thread: ") + error.what(), info.name,
                 "close other programs, or raise the process limit (ulimit -u)"};
  }
  const bool interrupted = !watch(driver, trial, removed, settings.heartbeat, progress, info.name);
  // the forces are already zero; the driver is halted as well
  if (trial.ended() != GripTrial::EndReason::kDone) driver.halt();
  if (interrupted) trial.end(GripTrial::EndReason::kFault);
  clock.stop();
  await_end(removed, settings.heartbeat);
  running.join();
  if (settings.heartbeat) settings.heartbeat->checked_ns.store(Heartbeat::kResting);
  if (interrupted) return Error{ErrorKind::kInterrupted, "stopped", "", ""};
  if (trial.ended() != GripTrial::EndReason::kDone) return error_of(trial.ended(), driver, info.name);
  progress.report("holding " + info.name, 1);
  auto figures = trial.figures();
  if (!figures)
    return Error{ErrorKind::kUnavailable, "the tip moved too little to measure the delay", info.name,
                 "hold it more lightly, at one place, and try again"};
  figures->device = printable_name(info.name);
  return *std::move(figures);
}

}  // namespace palpate
