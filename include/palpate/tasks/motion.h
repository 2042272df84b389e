#pragma once

#include <array>
#include <cstdint>

#include <Eigen/Core>

/// Kinematic metrics of the tool tip from samples at any rate.
namespace palpate {

/// Second-order Butterworth low-pass filter, integrated exactly for piecewise linear input, so that the
/// output does not depend on the sample rate:
///
///     x'' = w^2 (u - x) - sqrt(2) w x'
class LowPass {
 public:
  static constexpr double kCutoff_Hz = 10;

  /// Initialises the filter in steady state at u.
  void begin(const Eigen::Vector3d& u);
  /// Advances by dt_s > 0, during which the input changes linearly to u.
  void advance(const Eigen::Vector3d& u, double dt_s);
  /// Output at an intermediate time of the next advance(u, dt_s).
  /// @param after_s  0 ... dt_s
  Eigen::Vector3d position_during(const Eigen::Vector3d& u, double dt_s, double after_s) const;

  const Eigen::Vector3d& position() const { return x_; }
  const Eigen::Vector3d& velocity() const { return v_; }  ///< Derivative of the output, 1/s

 private:
  struct State {
    Eigen::Vector3d x, v;
  };
  State after(const Eigen::Vector3d& u, double dt_s, double after_s) const;

  Eigen::Vector3d u_ = Eigen::Vector3d::Zero(), x_ = Eigen::Vector3d::Zero(), v_ = Eigen::Vector3d::Zero();
};

/// Path length, smoothness and idle time of a motion; mm and s.
class MotionMeter {
 public:
  /// Sample interval at which jerk is evaluated.
  static constexpr double kGrid_s = 0.01;
  /// Settling time of the filter; jerk is accumulated after it.
  static constexpr double kSettled_s = 0.3;
  static constexpr double kIdleBelow_mm_s = 5;

  /// @param time_s  strictly increasing
  void observe(double time_s, const Eigen::Vector3d& tip_mm, bool touching);

  double path_mm() const { return path_mm_; }
  double idle_s() const { return idle_s_; }
  /// Log dimensionless jerk; NaN without motion, or for less than half a second of it.
  double smoothness() const;
  const Eigen::Vector3d& position() const { return filter_.position(); }

 private:
  void take_grid_point(const Eigen::Vector3d& x);

  LowPass filter_;
  bool begun_ = false;
  double started_s_ = 0, time_s_ = 0;
  double path_mm_ = 0, idle_s_ = 0;
  bool was_touching_ = false;
  std::array<Eigen::Vector3d, 4> grid_{};         // newest last
  std::uint64_t grid_points_ = 0, in_a_row_ = 0;  // in_a_row_: since the last long gap
  double jerk2_ = 0, max_speed_mm_s_ = 0;         // jerk2_: sum of squares over the grid
};

}  // namespace palpate
