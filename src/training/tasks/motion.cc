#include "palpate/tasks/motion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate {
namespace {

constexpr double kOmega = 2 * std::numbers::pi * LowPass::kCutoff_Hz;
// absolute value of the real and imaginary parts of both poles
constexpr double kDecay = kOmega / std::numbers::sqrt2;
constexpr double kLag_s = std::numbers::sqrt2 / kOmega;  // steady-state lag behind a ramp

}  // namespace

void LowPass::begin(const Eigen::Vector3d& u) {
  u_ = x_ = u;
  v_.setZero();
}

// steady-state response to a ramp, plus the decaying homogeneous solution
LowPass::State LowPass::after(const Eigen::Vector3d& u, double dt_s, double after_s) const {
  const Eigen::Vector3d slope = (u - u_) / dt_s;
  const Eigen::Vector3d off = x_ - (u_ - slope * kLag_s), off_v = v_ - slope;
  const double e = std::exp(-kDecay * after_s), c = std::cos(kDecay * after_s),
               s = std::sin(kDecay * after_s);
  const Eigen::Vector3d x = e * ((c + s) * off + (s / kDecay) * off_v);
  const Eigen::Vector3d v = e * ((c - s) * off_v - (kOmega * kOmega / kDecay * s) * off);
  return {u_ + slope * (after_s - kLag_s) + x, slope + v};
}

void LowPass::advance(const Eigen::Vector3d& u, double dt_s) {
  const State next = after(u, dt_s, dt_s);
  x_ = next.x;
  v_ = next.v;
  u_ = u;
}

Eigen::Vector3d LowPass::position_during(const Eigen::Vector3d& u, double dt_s, double after_s) const {
  return after(u, dt_s, after_s).x;
}

void MotionMeter::observe(double time_s, const Eigen::Vector3d& tip_mm, bool touching) {
  if (!begun_) {
    begun_ = true;
    started_s_ = time_s_ = time_s;
    was_touching_ = touching;
    filter_.begin(tip_mm);
    take_grid_point(tip_mm);
    return;
  }
  const double dt_s = time_s - time_s_;
  // grid times within this interval; a gap of more than a minute is excluded
  constexpr double kMaxGap_s = 60;
  if (dt_s < kMaxGap_s) {
    while (true) {
      const double grid_s = started_s_ + static_cast<double>(grid_points_) * kGrid_s;
      if (grid_s > time_s) break;
      take_grid_point(filter_.position_during(tip_mm, dt_s, grid_s - time_s_));
    }
  } else {
    started_s_ = time_s - static_cast<double>(grid_points_ - 1) * kGrid_s;
    in_a_row_ = 0;
  }
  const Eigen::Vector3d before = filter_.position();
  filter_.advance(tip_mm, dt_s);
  path_mm_ += (filter_.position() - before).norm();
  if (!touching && !was_touching_ && filter_.velocity().norm() < kIdleBelow_mm_s) idle_s_ += dt_s;
  was_touching_ = touching;
  time_s_ = time_s;
}

void MotionMeter::take_grid_point(const Eigen::Vector3d& x) {
  std::rotate(grid_.begin(), grid_.begin() + 1, grid_.end());
  grid_.back() = x;
  ++grid_points_;
  ++in_a_row_;
  const double first_s = static_cast<double>(grid_points_ - 1) * kGrid_s - 3 * kGrid_s;
  if (in_a_row_ < grid_.size() || first_s < kSettled_s - 1e-9) return;
  const Eigen::Vector3d jerk =
      (grid_[3] - 3 * grid_[2] + 3 * grid_[1] - grid_[0]) / (kGrid_s * kGrid_s * kGrid_s);
  jerk2_ += jerk.squaredNorm();
  max_speed_mm_s_ = std::max(max_speed_mm_s_, (grid_[2] - grid_[1]).norm() / kGrid_s);
}

double MotionMeter::smoothness() const {
  const double length_s = static_cast<double>(grid_points_) * kGrid_s - kSettled_s - 3 * kGrid_s;
  constexpr double kMinLength_s = 0.5;
  if (length_s < kMinLength_s || !(max_speed_mm_s_ > 0) || !(jerk2_ > 0))
    return std::numeric_limits<double>::quiet_NaN();
  const double integral = jerk2_ * kGrid_s;
  return -std::log(length_s * length_s * length_s / (max_speed_mm_s_ * max_speed_mm_s_) * integral);
}

}  // namespace palpate
