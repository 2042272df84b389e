#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/doctor/held_hand.h"

namespace palpate {

/// A way of the tip and what pushed it, tick by tick.
struct PushedTick {
  double time_s;
  double tip_m;    ///< along one axis
  double force_N;  ///< from then on
};

/// The delay with which the force explains the way best, s: of a mass on spring, damper and dry friction.
/// Empty: another one does nearly as well.
/// @param ticks   a second or more
/// @param step_m  of the encoder
std::optional<double> delay_of(const std::vector<PushedTick>& ticks, double step_m);

/// The trial itself: what a driver calls. Its time is that of the samples. Nothing is allocated in a tick.
class HeldHandTrial final : public ServoFunction {
 public:
  enum class Ended : std::uint8_t {
    kNot,
    kDone,
    kMoved,
    kFast,
    kOld,
    kTimes,  ///< of samples, which are from the future or go back
    kFault,
    kNoNumber,
    kLate,
    kNotReady,  ///< it never began
    kSwung,     ///< with the softest spring
  };

  /// It begins with the first sample, and has to within kBegin_s from here.
  /// @param step_mm  of the encoder; held to what encoders have
  HeldHandTrial(const HeldHandSettings& settings, double rate_hz, double step_mm, TimeSource now);

  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override;
  /// From another thread: zeros from now on.
  void end(Ended why) noexcept;

  Ended ended() const { return ended_.load(); }
  std::int64_t last_update_ns() const { return last_update_ns_.load(); }
  bool begun() const { return begun_.load(); }
  /// 0 ... 1
  double part_done() const { return part_done_.load(); }
  /// After its end: delay, rate and stiffness. Empty: the delay is not clear.
  std::optional<HeldHandFigures> figures() const;

  static constexpr double kRest_s = 0.5, kPushed_s = 2, kSettle_s = 0.4, kSpring_s = 0.4;
  /// The pushes begin again, and their mean is 0 over it.
  static constexpr double kPushPeriod_s = 0.64;
  /// Whoever armed it holds still for so long, and knows when it begins.
  static constexpr double kBegin_s = 2;

 private:
  struct Place {
    std::int64_t taken_ns;
    Eigen::Vector3d tip_mm;
  };
  bool too_fast(std::int64_t taken_ns, const Eigen::Vector3d& tip_mm);
  Ended odd_time(const DeviceSample& sample, std::int64_t now_ns, std::int64_t before_ns) const;
  Eigen::Vector3d force(const DeviceSample& sample, double time_s);
  Eigen::Vector3d push(double time_s);
  Eigen::Vector3d spring(const Eigen::Vector3d& tip_mm, double time_s);
  void judge();

  const HeldHandSettings settings_;
  const TimeSource now_;
  const std::int64_t made_ns_;
  const double step_mm_, threshold_mm_;
  std::int64_t begun_ns_ = 0, last_taken_ns_ = 0;
  std::uint64_t ticks_ = 0;
  double ended_at_s_ = 0;
  Eigen::Vector3d rest_mm_ = Eigen::Vector3d::Zero(), slow_mm_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d first_rest_mm_ = Eigen::Vector3d::Zero();
  // a ring of where the tip was
  std::array<Place, 128> places_;
  std::size_t oldest_ = 0, kept_ = 0;
  std::uint64_t rested_ = 0;
  std::vector<PushedTick> pushed_;
  double stiffness_N_per_mm_, held_N_per_mm_ = 0, spring_begun_s_ = kRest_s + kPushed_s + kSettle_s;
  std::optional<double> swings_N_per_mm_;
  // of the last two quarters of a spring: how far the tip swings
  double early_mm2_ = 0, late_mm2_ = 0, late_most_mm_ = 0;
  std::uint64_t early_ = 0, late_ = 0;
  std::atomic<Ended> ended_{Ended::kNot};
  std::atomic<std::int64_t> last_update_ns_{0};
  std::atomic<bool> begun_{false};
  std::atomic<double> part_done_{0};
};

}  // namespace palpate
