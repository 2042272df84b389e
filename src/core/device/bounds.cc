#include "palpate/device/bounds.h"

#include <cmath>
#include <numbers>

namespace palpate {
namespace {

// stated value if it is plausible, else the conservative one
double known_or(const std::optional<double>& declared, double conservative, double smallest, double largest) {
  return declared && *declared >= smallest && *declared <= largest ? *declared : conservative;
}

}  // namespace

double neutral_damping_N_s_per_mm(double mass_kg, double rate_hz, double delay_s) {
  PALPATE_CHECK(rate_hz > 0);
  constexpr double kWindow_s = 0.01;
  const double late_s = delay_s + 0.5 / rate_hz + 0.5 * kWindow_s;
  const double swing_rad_s = 0.5 * std::numbers::pi / late_s;
  const double damping_N_s_per_m =
      mass_kg * swing_rad_s * swing_rad_s * kWindow_s / (2 * std::sin(0.5 * swing_rad_s * kWindow_s));
  return damping_N_s_per_m * 1e-3;
}

double conservative_delay_s(const DeviceInfo& info) {
  return known_or(info.delay_s, info.simulated ? 0 : ConservativeDevice{}.delay_s, 0, 1);
}

ConservativeBounds conservative_bounds(const DeviceInfo& info) {
  const ConservativeDevice conservative;
  const double rate_hz = known_or(info.rate_hz, conservative.rate_hz, 1, 1e5);
  const double delay_s = conservative_delay_s(info);
  const double mass_kg = known_or(info.mass_kg, conservative.mass_kg, 1e-3, 100);
  const double damping_N_s_per_m =
      conservative.hand_N_s_per_m + known_or(info.damping_N_s_per_m, conservative.damping_N_s_per_m, 0, 100);
  return {kStiffnessMargin * theoretical_stiffness_N_per_mm(damping_N_s_per_m, rate_hz, delay_s),
          kStiffnessMargin * neutral_damping_N_s_per_mm(mass_kg, rate_hz, delay_s)};
}

}  // namespace palpate
