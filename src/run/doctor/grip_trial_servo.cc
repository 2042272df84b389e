#include "doctor/grip_trial_servo.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "palpate/device/bounds.h"

namespace palpate {
namespace {

// overcomes a dry friction of 0.3 N
constexpr double kPush_N = 0.8;
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

}  // namespace

GripTrial::GripTrial(const GripTrialSettings& settings, double rate_hz, double step_mm, TimeSource now)
    : settings_(settings),
      now_(now),
      constructed_ns_(now()),
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
    if (1e-9 * static_cast<double>(now_ns - constructed_ns_) > kBegin_s) end(EndReason::kNotReady);
    return;
  }
  if (sample.fault) return end(EndReason::kFault);
  if (!sample.tip.all_finite()) return end(EndReason::kNotFinite);
  if (const EndReason odd = check_timestamps(sample, now_ns, before_ns); odd != EndReason::kNone)
    return end(odd);
  const Eigen::Vector3d& tip_mm = sample.tip.eigen();
  if (!begun_.load()) {
    started_ns_ = last_sampled_ns_ = sample.taken_ns;
    filtered_tip_mm_ = tip_mm;
    begun_.store(true);
  }
  const double time_s = 1e-9 * static_cast<double>(sample.taken_ns - started_ns_);
  const double passed_s = 1e-9 * static_cast<double>(sample.taken_ns - last_sampled_ns_);
  Eigen::Vector3d requested = force(sample, time_s);
  if (too_fast(sample.taken_ns, tip_mm)) end(EndReason::kTooFast);
  filtered_tip_mm_ += (tip_mm - filtered_tip_mm_) * std::min(1.0, passed_s / kLowPass_s);
  last_sampled_ns_ = sample.taken_ns;
  ++ticks_;
  ended_at_s_ = time_s;
  if (!requested.allFinite()) end(EndReason::kNotFinite);
  if (ended_.load() != EndReason::kNone) return;
  if (const double size = requested.norm(); size > settings_.max_force_N)
    requested *= settings_.max_force_N / size;
  if (time_s >= kRest_s && time_s < kRest_s + kPushed_s && pushed_.size() < pushed_.capacity())
    pushed_.push_back({time_s, 1e-3 * sample.tip.x(), requested.x()});
  commands[0].force_N = Vector<Device>(requested);
}

// checks the time stamps of the sample and of the tick
GripTrial::EndReason GripTrial::check_timestamps(const DeviceSample& sample, std::int64_t now_ns,
                                                 std::int64_t before_ns) const {
  const double age_s = 1e-9 * static_cast<double>(now_ns - sample.taken_ns);
  if (age_s > kMaxAge_s) return EndReason::kStaleSample;
  if (age_s < -kFuture_s) return EndReason::kBadTimestamps;
  if (!begun_.load())
    return 1e-9 * static_cast<double>(now_ns - constructed_ns_) > kBegin_s ? EndReason::kNotReady
                                                                           : EndReason::kNone;
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
  rest_mm_ = filtered_tip_mm_;
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
  return {sign * std::min(kPush_N, settings_.max_force_N), 0, 0};
}

Eigen::Vector3d GripTrial::spring(const Eigen::Vector3d& tip_mm, double time_s) {
  const double within_s = time_s - spring_started_s_;
  if (within_s >= kSpring_s) {
    evaluate_spring();
    if (ended_.load() != EndReason::kNone) return Eigen::Vector3d::Zero();
    spring_started_s_ = time_s;
    // follow the slow drift of the hand
    rest_mm_ = filtered_tip_mm_;
  }
  const double swing_mm = (tip_mm - filtered_tip_mm_).norm();
  if (within_s >= 0.5 * kSpring_s && within_s < 0.75 * kSpring_s) {
    early_mm2_ += swing_mm * swing_mm;
    ++early_;
  } else if (within_s >= 0.75 * kSpring_s && within_s < kSpring_s) {
    late_mm2_ += swing_mm * swing_mm;
    ++late_;
    late_max_mm_ = std::max(late_max_mm_, swing_mm);
  }
  Eigen::Vector3d requested = -stiffness_N_per_mm_ * (tip_mm - rest_mm_);
  if (within_s < kKnock_s) requested.x() += kKnock_N;
  return requested;
}

void GripTrial::evaluate_spring() {
  const double early = early_ > 0 ? std::sqrt(early_mm2_ / static_cast<double>(early_)) : 0;
  const double late = late_ > 0 ? std::sqrt(late_mm2_ / static_cast<double>(late_)) : 0;
  if (late_max_mm_ > threshold_mm_ && late > kPersistentRatio * early) {
    // no stiffness was found stable
    if (stable_N_per_mm_ == 0) return end(EndReason::kOscillated);
    oscillating_N_per_mm_ = stiffness_N_per_mm_;
    return end(EndReason::kDone);
  }
  stable_N_per_mm_ = stiffness_N_per_mm_;
  if (stiffness_N_per_mm_ >= settings_.max_N_per_mm) return end(EndReason::kDone);
  stiffness_N_per_mm_ = std::min(settings_.max_N_per_mm, stiffness_N_per_mm_ * settings_.growth);
  early_mm2_ = late_mm2_ = late_max_mm_ = 0;
  early_ = late_ = 0;
}

std::optional<GripTrialFigures> GripTrial::figures() const {
  const auto delay_s = delay_of(pushed_, 1e-3 * step_mm_);
  if (!delay_s) return std::nullopt;
  GripTrialFigures figures;
  figures.rate_hz = ended_at_s_ > 0 ? static_cast<double>(ticks_) / ended_at_s_ : 0;
  figures.delay_s = *delay_s;
  figures.stable_N_per_mm = stable_N_per_mm_;
  figures.oscillating_N_per_mm = oscillating_N_per_mm_;
  figures.recommended_N_per_mm = kStiffnessMargin * oscillating_N_per_mm_.value_or(stable_N_per_mm_);
  return figures;
}

}  // namespace palpate
