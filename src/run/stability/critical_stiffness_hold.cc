#include "stability/critical_stiffness_hold.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate {
namespace {

constexpr double kHold_N = 1;
// the hand accelerates smoothly, so that its spring does not oscillate, and moves uniformly before the impact
constexpr double kSpeedUp_s = 0.6, kEven_s = 0.1;
// time in which a hand resting on the surface reaches its force
constexpr double kPress_s = 0.05;

// displacement after t divided by the final speed; the speed rises as a raised cosine
double accelerated_path_s(double t_s) {
  if (t_s >= kSpeedUp_s) return t_s - kSpeedUp_s / 2;
  const double pi = std::numbers::pi;
  return (t_s - kSpeedUp_s / pi * std::sin(pi * t_s / kSpeedUp_s)) / 2;
}

}  // namespace

WallHold::WallHold(const StabilityCase& stability_case, double stiffness_N_per_mm, double impact_m_s)
    : dt_s_(1 / stability_case.rate_hz),
      stiffness_N_per_mm_(stiffness_N_per_mm),
      device_(stability_case.device, stability_case.hand, stability_case.delay_s) {
  const double hand_N_per_mm = stability_case.hand.stiffness_N_per_m * 1e-3;
  const double depth_mm = kHold_N / stiffness_N_per_mm + kHold_N / hand_N_per_mm;
  const double speed_mm_s = impact_m_s > 0 ? impact_m_s * 1e3 : depth_mm / kPress_s;
  const double start_mm = impact_m_s > 0 ? speed_mm_s * accelerated_path_s(kSpeedUp_s + kEven_s) : 0;

  device_.reset(Point<Device>(start_mm, 0, 0));
  for (double t_s = dt_s_; intended_mm_ > -depth_mm; t_s += dt_s_) {
    const double path_s = impact_m_s > 0 ? accelerated_path_s(t_s) : t_s;
    intended_mm_ = std::max(-depth_mm, start_mm - speed_mm_s * path_s);
    tick();
  }
}

double WallHold::wall_force_N() const {
  return stiffness_N_per_mm_ * std::max(0.0, -device_.read().tip.x());
}

void WallHold::tick() {
  device_.intend(Point<Device>(intended_mm_, 0, 0));
  device_.advance({Vector<Device>(wall_force_N(), 0, 0), {}}, dt_s_);
}

double WallHold::next_amplitude_mm() {
  double low_mm = std::numeric_limits<double>::infinity(), high_mm = -low_mm;
  const long ticks = std::lround(1 / dt_s_);
  for (long n = 0; n < ticks; ++n) {
    tick();
    const double x_mm = device_.true_tip().x();
    low_mm = std::min(low_mm, x_mm);
    high_mm = std::max(high_mm, x_mm);
  }
  return high_mm - low_mm;
}

bool has_limit_cycle(const StabilityCase& stability_case, double stiffness_N_per_mm, double impact_m_s) {
  const double quiet_mm = 2 * stability_case.device.encoder_step_m * 1e3;
  WallHold hold(stability_case, stiffness_N_per_mm, impact_m_s);
  double swing_mm = hold.next_amplitude_mm();
  for (int second = 2; second <= kMaxHold_s; ++second) {
    const double before_mm = swing_mm;
    swing_mm = hold.next_amplitude_mm();
    if (swing_mm <= quiet_mm) return false;
    if (swing_mm >= before_mm) return true;
  }
  return true;
}

bool oscillates_after_a_second(const StabilityCase& stability_case, double stiffness_N_per_mm,
                               double impact_m_s) {
  WallHold hold(stability_case, stiffness_N_per_mm, impact_m_s);
  hold.next_amplitude_mm();
  return hold.next_amplitude_mm() > 2 * stability_case.device.encoder_step_m * 1e3;
}

}  // namespace palpate
