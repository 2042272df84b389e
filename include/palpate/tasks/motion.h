#pragma once

#include <array>
#include <cstdint>

#include <Eigen/Core>

/// How a tip moved, from samples at any rate.
namespace palpate {

/// A second-order Butterworth low-pass, solved exactly for input that is straight between samples, so that
/// what comes out does not depend on how many samples there are.
///
///     x'' = w^2 (u - x) - sqrt(2) w x'
class LowPass {
 public:
  static constexpr double kCutoff_Hz = 10;

  /// At rest at u.
  void begin(const Eigen::Vector3d& u);
  /// The input has gone straight to u in dt_s > 0.
  void advance(const Eigen::Vector3d& u, double dt_s);
  /// Where it would be a part of the way through the next advance(u, dt_s). @param after_s  0 ... dt_s
  Eigen::Vector3d position_during(const Eigen::Vector3d& u, double dt_s, double after_s) const;

  const Eigen::Vector3d& position() const { return x_; }
  const Eigen::Vector3d& velocity() const { return v_; }  ///< 1/s

 private:
  struct State {
    Eigen::Vector3d x, v;
  };
  State after(const Eigen::Vector3d& u, double dt_s, double after_s) const;

  Eigen::Vector3d u_ = Eigen::Vector3d::Zero(), x_ = Eigen::Vector3d::Zero(), v_ = Eigen::Vector3d::Zero();
};

/// Length, smoothness and rest of a way, mm and s.
class MotionMeter {
 public:
  /// Of the grid of times at which jerk is taken.
  static constexpr double kGrid_s = 0.01;
  /// After so long the filter has forgotten that it began at rest; jerk counts from there.
  static constexpr double kSettled_s = 0.3;
  static constexpr double kIdleBelow_mm_s = 5;

  /// @param time_s  grows from call to call
  void see(double time_s, const Eigen::Vector3d& tip_mm, bool touching);

  double path_mm() const { return path_mm_; }
  double idle_s() const { return idle_s_; }
  /// Log dimensionless jerk; NaN where there was no motion, or not half a second of it.
  double smoothness() const;
  const Eigen::Vector3d& position() const { return filter_.position(); }

 private:
  void take_grid_point(const Eigen::Vector3d& x);

  LowPass filter_;
  bool begun_ = false;
  double begun_s_ = 0, time_s_ = 0;
  double path_mm_ = 0, idle_s_ = 0;
  bool was_touching_ = false;
  std::array<Eigen::Vector3d, 4> grid_{};         // newest last
  std::uint64_t grid_points_ = 0, in_a_row_ = 0;  // in a row: since the last long gap
  double jerk2_ = 0, max_speed_mm_s_ = 0;         // sum of squares over the grid
};

}  // namespace palpate
