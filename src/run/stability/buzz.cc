#include "stability/buzz.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace palpate {
namespace {

constexpr double kLowest_Hz = 20, kHighest_Hz = 500;
// rounding level: lower power counts as none
constexpr double kMinPower_mm2 = 1e-12;

// power spectrum of one axis up to the Nyquist frequency, without the mean; the Hann window reduces leakage
// of drift into higher frequencies
std::vector<double> power_mm2(std::span<const Eigen::Vector3d> tip_mm, int axis) {
  const int n = static_cast<int>(tip_mm.size());
  const double angle_step = 2 * std::numbers::pi / n;
  double mean = 0;
  for (const Eigen::Vector3d& tip : tip_mm) mean += tip[axis] / n;
  std::vector<std::complex<double>> twiddles(n);
  for (int i = 0; i < n; ++i) twiddles[i] = std::polar(1.0, -angle_step * i);

  std::vector<double> power(n / 2 + 1, 0.0);
  for (int k = 1; k <= n / 2; ++k) {
    std::complex<double> sum = 0;
    for (int i = 0; i < n; ++i) {
      const double hann = 0.5 * (1 - twiddles[i].real());
      sum += hann * (tip_mm[i][axis] - mean) * twiddles[static_cast<long>(k) * i % n];
    }
    // both signs of the frequency; the window removes 5/8 of the power
    const double sides = 2 * k == n ? 1 : 2;
    power[k] = sides * std::norm(sum) / (static_cast<double>(n) * n) * (8.0 / 3);
  }
  return power;
}

double spread_mm(std::span<const Eigen::Vector3d> tip_mm, int axis) {
  const auto by_axis = [axis](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return a[axis] < b[axis];
  };
  const auto [low, high] = std::minmax_element(tip_mm.begin(), tip_mm.end(), by_axis);
  return (*high)[axis] - (*low)[axis];
}

}  // namespace

Buzz buzz_of(std::span<const Eigen::Vector3d> tip_mm, std::span<const Eigen::Vector3d> force_N,
             double rate_hz) {
  PALPATE_CHECK(tip_mm.size() >= 2 && force_N.size() + 1 == tip_mm.size() && rate_hz > 0);
  Buzz buzz;
  // positions at the beginning of each tick give integer frequencies over a second
  const auto ticks = tip_mm.first(force_N.size());
  std::vector<double> power(ticks.size() / 2 + 1, 0.0);
  for (int axis = 0; axis < 3; ++axis) {
    const double axis_mm = spread_mm(tip_mm, axis);
    buzz.peak_to_peak_um = std::max(buzz.peak_to_peak_um, 1e3 * axis_mm);
    if (axis_mm == 0) continue;
    const auto of_axis = power_mm2(ticks, axis);
    for (std::size_t k = 0; k < power.size(); ++k) power[k] += of_axis[k];
  }

  const double step_Hz = rate_hz / static_cast<double>(ticks.size());
  double in_band = 0, most = kMinPower_mm2;
  for (std::size_t k = 1; k < power.size(); ++k) {
    const double frequency_Hz = static_cast<double>(k) * step_Hz;
    if (frequency_Hz >= kLowest_Hz && frequency_Hz <= kHighest_Hz) in_band += power[k];
    if (power[k] > most) {
      most = power[k];
      buzz.dominant_Hz = frequency_Hz;
    }
  }
  buzz.rms_um = 1e3 * std::sqrt(in_band);
  for (std::size_t i = 0; i < force_N.size(); ++i) {
    buzz.energy_mJ += force_N[i].dot(tip_mm[i + 1] - tip_mm[i]);
    buzz.force_N += force_N[i].norm() / static_cast<double>(force_N.size());
  }
  return buzz;
}

}  // namespace palpate
