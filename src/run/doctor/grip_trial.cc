#include "palpate/doctor/grip_trial.h"

#include <time.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <system_error>
#include <thread>

#include "doctor/grip_trial_servo.h"
#include "palpate/base/clock.h"
#include "palpate/base/printable.h"
#include "palpate/device/bounds.h"
#include "palpate/servo/realtime.h"

namespace palpate {
namespace {

constexpr double kWindow_s = 0.5, kMaxDelay_s = 0.02, kDelayStep_s = 0.25e-3;
// kPush_N overcomes a dry friction of 0.3 N. A latency is accepted if the residual of others at least
// kOtherDelay_s away is larger by the factor kClearly
constexpr double kPush_N = 0.8, kDirection_s = 0.008, kOtherDelay_s = 0.0015, kClearly = 1.5;
constexpr double kKnock_N = 0.4, kKnock_s = 0.01;
// time constant of the tip's low-pass filter; voluntary motion is slower
constexpr double kLowPass_s = 0.008;
// minimum amplitude of an oscillation: four encoder steps, and the threshold of perception
constexpr double kMinSwing_steps = 4, kMin_mm = 0.03;
// ratio of successive amplitudes above which an oscillation counts as persistent
constexpr double kPersistentRatio = 0.7;
constexpr double kMaxDisplacement_mm = 15, kMaxSpeed_mm_s = 500, kMaxAge_s = 0.01, kMaxRest_mm = 3;
constexpr double kFuture_s = 0.001;
// speed is averaged over this time, so that an encoder step within one tick does not count
constexpr std::int64_t kSpeedWindow_ns = 8'000'000, kMinStoredPeriod_ns = 250'000;
constexpr double kFinestStep_mm = 1e-4, kCoarsestStep_mm = 0.2;
constexpr std::int64_t kLate_ns = 9'000'000;
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

// second time integral of the force, which is held constant between ticks and acts delay_s later
class DoubleIntegral {
 public:
  DoubleIntegral(const std::vector<PushedTick>& ticks, std::size_t from, std::size_t to, double delay_s) {
    const double started_s = ticks[from].time_s;
    double once = 0, twice = 0, last_s = started_s;
    // forces commanded before the window act within it
    std::size_t acting = 0;
    const auto force_at = [&](double time_s) {
      while (acting + 1 < ticks.size() && ticks[acting + 1].time_s + delay_s <= time_s) ++acting;
      return ticks[acting].time_s + delay_s <= time_s ? ticks[acting].force_N : 0.0;
    };
    for (std::size_t n = from; n < to; ++n) {
      // split the tick at every change of the delayed force
      while (last_s < ticks[n].time_s) {
        const double force_N = force_at(last_s);
        double next_s = ticks[n].time_s;
        if (acting + 1 < ticks.size())
          next_s =
              std::clamp(ticks[acting + 1].time_s + delay_s, last_s + 1e-9, std::max(next_s, last_s + 1e-9));
        next_s = std::min(next_s, ticks[n].time_s);
        const double dt = next_s - last_s;
        if (!(dt > 0)) break;
        twice += once * dt + 0.5 * force_N * dt * dt;
        once += force_N * dt;
        last_s = next_s;
      }
      last_s = ticks[n].time_s;
      values_.push_back(twice);
    }
  }
  const std::vector<double>& values() const { return values_; }

 private:
  std::vector<double> values_;
};

// first and second time integral, by the trapezoidal rule
struct Integrals {
  std::vector<double> once, twice;
  Integrals(const std::vector<PushedTick>& ticks, std::size_t from, std::size_t to,
            const std::vector<double>& values) {
    double first = 0, second = 0;
    for (std::size_t n = from; n < to; ++n) {
      if (n > from) {
        const double dt = ticks[n].time_s - ticks[n - 1].time_s;
        const double mean = 0.5 * (values[n] + values[n - 1]);
        second += first * dt + 0.5 * mean * dt * dt;
        first += mean * dt;
      }
      once.push_back(first);
      twice.push_back(second);
    }
  }
};

// Direction of motion at each tick, -1 ... 1, i.e. that of dry friction, from the displacement over an
// interval around the tick. A displacement below an encoder step counts as rest.
std::vector<double> directions(const std::vector<PushedTick>& ticks, double step_m) {
  std::vector<double> found(ticks.size(), 0.0);
  std::size_t before = 0, after = 0;
  for (std::size_t n = 0; n < ticks.size(); ++n) {
    while (ticks[before].time_s < ticks[n].time_s - kDirection_s) ++before;
    while (after + 1 < ticks.size() && ticks[after].time_s < ticks[n].time_s + kDirection_s) ++after;
    found[n] = std::clamp((ticks[after].tip_m - ticks[before].tip_m) / (1.5 * step_m), -1.0, 1.0);
  }
  return found;
}

/// A window of the motion, with the terms of its equation that do not depend on the latency.
class Window {
 public:
  Window(const std::vector<PushedTick>& ticks, const std::vector<double>& directions, std::size_t from,
         std::size_t to)
      : ticks_(ticks), from_(from), to_(to) {
    const auto size = static_cast<Eigen::Index>(to - from);
    std::vector<double> path(ticks.size());
    for (std::size_t n = from; n < to; ++n) path[n] = ticks[n].tip_m - ticks[from].tip_m;
    const Integrals of_path(ticks, from, to, path), of_direction(ticks, from, to, directions);
    terms_.resize(size, 7);
    path_.resize(size);
    for (Eigen::Index i = 0; i < size; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double t = ticks[from + k].time_s - ticks[from].time_s;
      // constant, linear and quadratic terms account for the initial state and the spring's rest position
      terms_.row(i) << 0, of_path.once[k], of_path.twice[k], of_direction.twice[k], 1, t, t * t;
      path_[i] = path[from + k];
    }
    normalise(terms_.rightCols(6));
  }
  /// Residual sum of squares of a fit with this latency, m^2.
  double residual_m2(double delay_s) {
    const auto force = DoubleIntegral(ticks_, from_, to_, delay_s).values();
    terms_.col(0) = Eigen::Map<const Eigen::VectorXd>(force.data(), static_cast<Eigen::Index>(force.size()));
    normalise(terms_.leftCols(1));
    const Eigen::VectorXd fitted = terms_.colPivHouseholderQr().solve(path_);
    return (terms_ * fitted - path_).squaredNorm();
  }

 private:
  // scales the columns to unit norm
  static void normalise(Eigen::Ref<Eigen::MatrixXd> terms) {
    for (Eigen::Index c = 0; c < terms.cols(); ++c)
      if (const double size = terms.col(c).norm(); size > 0) terms.col(c) /= size;
  }

  const std::vector<PushedTick>& ticks_;
  std::size_t from_, to_;
  Eigen::MatrixXd terms_;
  Eigen::VectorXd path_;
};

}  // namespace

std::optional<double> delay_of(const std::vector<PushedTick>& ticks, double step_m) {
  const std::vector<double> directed = directions(ticks, step_m);
  std::vector<Window> windows;
  for (std::size_t from = 0, n = 0; n < ticks.size(); ++n)
    if (ticks[n].time_s - ticks[from].time_s >= kWindow_s) {
      windows.emplace_back(ticks, directed, from, n);
      from = n;
    }
  std::vector<double> left;
  for (int d = 0; d * kDelayStep_s <= kMaxDelay_s; ++d) {
    left.push_back(0);
    for (Window& window : windows) left.back() += window.residual_m2(d * kDelayStep_s);
  }
  const auto best = std::ranges::min_element(left);
  const auto index = best - left.begin();
  double others = std::numeric_limits<double>::infinity();
  for (std::ptrdiff_t d = 0; d < std::ssize(left); ++d)
    if (static_cast<double>(std::abs(d - index)) * kDelayStep_s >= kOtherDelay_s)
      others = std::min(others, left[static_cast<std::size_t>(d)]);
  if (!(others > kClearly * *best)) return std::nullopt;
  return static_cast<double>(index) * kDelayStep_s;
}

GripTrial::GripTrial(const GripTrialSettings& settings, double rate_hz, double step_mm, TimeSource now)
    : settings_(settings),
      now_(now),
      made_ns_(now()),
      step_mm_(std::isfinite(step_mm) ? std::clamp(step_mm, kFinestStep_mm, kCoarsestStep_mm)
                                      : kCoarsestStep_mm),
      threshold_mm_(std::max(kMinSwing_steps * step_mm_, kMin_mm)),
      stiffness_N_per_mm_(settings.first_N_per_mm) {
  pushed_.reserve(static_cast<std::size_t>(2 * rate_hz * kPushed_s) + 16);
}

void GripTrial::end(EndReason why) noexcept {
  EndReason none = EndReason::kNone;
  ended_.compare_exchange_strong(none, why);
}

void GripTrial::update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept {
  for (DeviceCommand& command : commands) command = {};
  const DeviceSample& sample = samples[0];
  const std::int64_t now_ns = now_(), before_ns = last_update_ns_.exchange(now_ns);
  if (ended_.load() != EndReason::kNone) return;
  // no sample yet
  if (!begun_.load() && (sample.fault || sample.taken_ns == 0)) {
    if (1e-9 * static_cast<double>(now_ns - made_ns_) > kBegin_s) end(EndReason::kNotReady);
    return;
  }
  if (sample.fault) return end(EndReason::kFault);
  if (!sample.tip.all_finite()) return end(EndReason::kNotFinite);
  if (const EndReason odd = odd_time(sample, now_ns, before_ns); odd != EndReason::kNone) return end(odd);
  const Eigen::Vector3d& tip_mm = sample.tip.eigen();
  if (!begun_.load()) {
    started_ns_ = last_sampled_ns_ = sample.taken_ns;
    slow_mm_ = tip_mm;
    begun_.store(true);
  }
  const double time_s = 1e-9 * static_cast<double>(sample.taken_ns - started_ns_);
  const double passed_s = 1e-9 * static_cast<double>(sample.taken_ns - last_sampled_ns_);
  Eigen::Vector3d requested = force(sample, time_s);
  if (too_fast(sample.taken_ns, tip_mm)) end(EndReason::kTooFast);
  slow_mm_ += (tip_mm - slow_mm_) * std::min(1.0, passed_s / kLowPass_s);
  last_sampled_ns_ = sample.taken_ns;
  ++ticks_;
  ended_at_s_ = time_s;
  if (!requested.allFinite()) end(EndReason::kNotFinite);
  if (ended_.load() != EndReason::kNone) return;
  if (const double size = requested.norm(); size > settings_.most_force_N)
    requested *= settings_.most_force_N / size;
  if (time_s >= kRest_s && time_s < kRest_s + kPushed_s && pushed_.size() < pushed_.capacity())
    pushed_.push_back({time_s, 1e-3 * sample.tip.x(), requested.x()});
  commands[0].force_N = Vector<Device>(requested);
}

// checks the time stamps of the sample and of the tick
GripTrial::EndReason GripTrial::odd_time(const DeviceSample& sample, std::int64_t now_ns,
                                         std::int64_t before_ns) const {
  const double age_s = 1e-9 * static_cast<double>(now_ns - sample.taken_ns);
  if (age_s > kMaxAge_s) return EndReason::kStaleSample;
  if (age_s < -kFuture_s) return EndReason::kBadTimestamps;
  if (!begun_.load())
    return 1e-9 * static_cast<double>(now_ns - made_ns_) > kBegin_s ? EndReason::kNotReady : EndReason::kNone;
  // also checked here, because the watchdog itself may be late
  if (now_ns - before_ns > kLate_ns) return EndReason::kLate;
  return sample.taken_ns < last_sampled_ns_ ? EndReason::kBadTimestamps : EndReason::kNone;
}

bool GripTrial::too_fast(std::int64_t taken_ns, const Eigen::Vector3d& tip_mm) {
  // keep as the oldest entry the newest one that is old enough
  while (stored_ > 1 && taken_ns - samples_[(oldest_ + 1) % samples_.size()].taken_ns >= kSpeedWindow_ns) {
    oldest_ = (oldest_ + 1) % samples_.size();
    --stored_;
  }
  const bool fast = stored_ > 0 && taken_ns - samples_[oldest_].taken_ns >= kSpeedWindow_ns &&
                    (tip_mm - samples_[oldest_].tip_mm).norm() >
                        kMaxSpeed_mm_s * 1e-9 * static_cast<double>(taken_ns - samples_[oldest_].taken_ns);
  const std::size_t newest = (oldest_ + stored_ + samples_.size() - 1) % samples_.size();
  if (stored_ == 0 || taken_ns - samples_[newest].taken_ns >= kMinStoredPeriod_ns) {
    samples_[(oldest_ + stored_) % samples_.size()] = {taken_ns, tip_mm};
    ++stored_;
  }
  return fast;
}

Eigen::Vector3d GripTrial::force(const DeviceSample& sample, double time_s) {
  const Eigen::Vector3d& tip_mm = sample.tip.eigen();
  const double steps =
      std::log(settings_.max_N_per_mm / settings_.first_N_per_mm) / std::log(settings_.growth);
  progress_.store(
      std::min(1.0, time_s / (kRest_s + kPushed_s + kSettle_s + std::max(1.0, steps) * kSpring_s)));
  if (time_s < kRest_s) {
    rest_mm_ += (tip_mm - rest_mm_) / static_cast<double>(++rested_);
    first_rest_mm_ = rest_mm_;
    if ((tip_mm - rest_mm_).norm() > kMaxRest_mm) end(EndReason::kMovedAway);
    return Eigen::Vector3d::Zero();
  }
  // also relative to the initial rest position, because a spring's rest position follows the hand
  if ((tip_mm - rest_mm_).norm() > kMaxDisplacement_mm ||
      (tip_mm - first_rest_mm_).norm() > kMaxDisplacement_mm) {
    end(EndReason::kMovedAway);
    return Eigen::Vector3d::Zero();
  }
  if (time_s < kRest_s + kPushed_s) return push(time_s - kRest_s);
  if (time_s >= kRest_s + kPushed_s + kSettle_s) return spring(tip_mm, time_s);
  // motion left by the pushes must not count as an oscillation of the first spring
  rest_mm_ = slow_mm_;
  return Eigen::Vector3d::Zero();
}

// Pushes in alternating directions with different durations, so that the latency is unambiguous. Their number
// is odd, so that the next round has opposite signs and the mean is zero.
Eigen::Vector3d GripTrial::push(double time_s) {
  constexpr std::array kLengths_s{0.03, 0.05, 0.02, 0.07, 0.04, 0.06, 0.05};
  static_assert(kLengths_s.size() % 2 == 1);
  double sign = 1, left_s = std::fmod(time_s, kPushPeriod_s);
  for (std::size_t n = 0; n < 2 * kLengths_s.size(); ++n) {
    const double length_s = kLengths_s[n % kLengths_s.size()];
    if (left_s < length_s) break;
    left_s -= length_s;
    sign = -sign;
  }
  return {sign * std::min(kPush_N, settings_.most_force_N), 0, 0};
}

Eigen::Vector3d GripTrial::spring(const Eigen::Vector3d& tip_mm, double time_s) {
  const double within_s = time_s - spring_started_s_;
  if (within_s >= kSpring_s) {
    judge();
    if (ended_.load() != EndReason::kNone) return Eigen::Vector3d::Zero();
    spring_started_s_ = time_s;
    // follow the slow drift of the hand
    rest_mm_ = slow_mm_;
  }
  const double swing_mm = (tip_mm - slow_mm_).norm();
  if (within_s >= 0.5 * kSpring_s && within_s < 0.75 * kSpring_s) {
    early_mm2_ += swing_mm * swing_mm;
    ++early_;
  } else if (within_s >= 0.75 * kSpring_s && within_s < kSpring_s) {
    late_mm2_ += swing_mm * swing_mm;
    ++late_;
    late_most_mm_ = std::max(late_most_mm_, swing_mm);
  }
  Eigen::Vector3d requested = -stiffness_N_per_mm_ * (tip_mm - rest_mm_);
  if (within_s < kKnock_s) requested.x() += kKnock_N;
  return requested;
}

void GripTrial::judge() {
  const double early = early_ > 0 ? std::sqrt(early_mm2_ / static_cast<double>(early_)) : 0;
  const double late = late_ > 0 ? std::sqrt(late_mm2_ / static_cast<double>(late_)) : 0;
  if (late_most_mm_ > threshold_mm_ && late > kPersistentRatio * early) {
    // no stiffness was found stable
    if (stable_N_per_mm_ == 0) return end(EndReason::kOscillated);
    swings_N_per_mm_ = stiffness_N_per_mm_;
    return end(EndReason::kDone);
  }
  stable_N_per_mm_ = stiffness_N_per_mm_;
  if (stiffness_N_per_mm_ >= settings_.max_N_per_mm) return end(EndReason::kDone);
  stiffness_N_per_mm_ = std::min(settings_.max_N_per_mm, stiffness_N_per_mm_ * settings_.growth);
  early_mm2_ = late_mm2_ = late_most_mm_ = 0;
  early_ = late_ = 0;
}

std::optional<GripTrialFigures> GripTrial::figures() const {
  const auto delay_s = delay_of(pushed_, 1e-3 * step_mm_);
  if (!delay_s) return std::nullopt;
  GripTrialFigures figures;
  figures.rate_hz = ended_at_s_ > 0 ? static_cast<double>(ticks_) / ended_at_s_ : 0;
  figures.delay_s = *delay_s;
  figures.stable_N_per_mm = stable_N_per_mm_;
  figures.swings_N_per_mm = swings_N_per_mm_;
  figures.advised_N_per_mm = kStiffnessMargin * swings_N_per_mm_.value_or(stable_N_per_mm_);
  return figures;
}

namespace {

Error ended_by(GripTrial::EndReason why, const DeviceDriver& driver, const std::string& device) {
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
    if (last_ns != 0 && now_ns - last_ns > kLate_ns) {
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
  PALPATE_CHECK(settings.most_force_N > 0 && settings.most_force_N <= 1 && settings.rate_hz >= 250 &&
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
  if (trial.ended() != GripTrial::EndReason::kDone) return ended_by(trial.ended(), driver, info.name);
  progress.report("holding " + info.name, 1);
  auto figures = trial.figures();
  if (!figures)
    return Error{ErrorKind::kUnavailable, "the tip moved too little to measure the delay", info.name,
                 "hold it more lightly, at one place, and try again"};
  figures->device = printable_name(info.name);
  return *std::move(figures);
}

}  // namespace palpate
