#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/doctor/grip_trial.h"

namespace palpate {

/// One tick of the tip's motion and the commanded force.
struct PushedTick {
  double time_s;
  double tip_m;    ///< Position along one axis
  double force_N;  ///< Commanded force, from this tick on
};

/// Latency, s, for which the force best explains the motion of a mass with spring, damper and dry friction.
/// Empty if another latency fits nearly as well.
/// @param ticks   at least a second
/// @param step_m  resolution of the encoder
std::optional<double> delay_of(const std::vector<PushedTick>& ticks, double step_m);

/// Servo function of the trial. Time is measured by the samples' time stamps. Does not allocate in a tick.
class GripTrial final : public ServoFunction {
 public:
  enum class EndReason : std::uint8_t {
    kNone,  ///< The trial has not ended
    kDone,
    kMovedAway,  ///< Farther from the rest position than kMaxDisplacement_mm, or kMaxRest_mm during the rest
    kTooFast,    ///< Speed above kMaxSpeed_mm_s
    kStaleSample,    ///< Sample older than kMaxAge_s
    kBadTimestamps,  ///< Time stamps decrease or are in the future
    kFault,
    kNotFinite,  ///< NaN or infinity in a sample
    kLate,
    kNotReady,    ///< It did not start
    kOscillated,  ///< Oscillation with the softest spring
  };

  /// The trial starts with the first sample, which has to arrive within kBegin_s from construction.
  /// @param step_mm  resolution of the encoder; clamped to plausible values
  GripTrial(const GripTrialSettings& settings, double rate_hz, double step_mm, TimeSource now);

  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override;
  /// Aborts the trial from another thread; forces are zero afterwards.
  void end(EndReason why) noexcept;

  EndReason ended() const { return ended_.load(); }
  std::int64_t last_update_ns() const { return last_update_ns_.load(); }
  bool begun() const { return begun_.load(); }
  /// Progress, 0 ... 1.
  double progress() const { return progress_.load(); }
  /// Latency, rate and stiffness after the end. Empty: the latency is ambiguous.
  std::optional<GripTrialFigures> figures() const;

  static constexpr double kRest_s = 0.5, kPushed_s = 2, kSettle_s = 0.4, kSpring_s = 0.4;
  /// Period of the sequence of pushes, over which its mean is 0.
  static constexpr double kPushPeriod_s = 0.64;
  /// Maximum time from arming to the start, during which the user holds the device still.
  static constexpr double kBegin_s = 2;
  /// Maximum time between ticks; also checked by the watchdog of the waiting thread.
  static constexpr std::int64_t kLate_ns = 9'000'000;

 private:
  struct Sample {
    std::int64_t taken_ns;
    Eigen::Vector3d tip_mm;
  };
  bool too_fast(std::int64_t taken_ns, const Eigen::Vector3d& tip_mm);
  EndReason check_timestamps(const DeviceSample& sample, std::int64_t now_ns, std::int64_t before_ns) const;
  Eigen::Vector3d force(const DeviceSample& sample, double time_s);
  Eigen::Vector3d push(double time_s);
  Eigen::Vector3d spring(const Eigen::Vector3d& tip_mm, double time_s);
  /// Decides whether the current spring is stable; sets the next stiffness, or ends the trial.
  void evaluate_spring();

  const GripTrialSettings settings_;
  const TimeSource now_;
  const std::int64_t constructed_ns_;
  const double step_mm_, threshold_mm_;
  std::int64_t started_ns_ = 0, last_sampled_ns_ = 0;
  std::uint64_t ticks_ = 0;
  double ended_at_s_ = 0;
  Eigen::Vector3d rest_mm_ = Eigen::Vector3d::Zero(), filtered_tip_mm_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d first_rest_mm_ = Eigen::Vector3d::Zero();
  // ring buffer of tip positions
  std::array<Sample, 128> samples_;
  std::size_t oldest_ = 0, stored_ = 0;
  std::uint64_t rested_ = 0;
  std::vector<PushedTick> pushed_;
  double stiffness_N_per_mm_, stable_N_per_mm_ = 0, spring_started_s_ = kRest_s + kPushed_s + kSettle_s;
  std::optional<double> oscillating_N_per_mm_;
  // mean squared and maximum deviation of the tip in the third and the fourth quarter of a spring's interval
  double early_mm2_ = 0, late_mm2_ = 0, late_max_mm_ = 0;
  std::uint64_t early_ = 0, late_ = 0;
  std::atomic<EndReason> ended_{EndReason::kNone};
  std::atomic<std::int64_t> last_update_ns_{0};
  std::atomic<bool> begun_{false};
  std::atomic<double> progress_{0};
};

}  // namespace palpate
