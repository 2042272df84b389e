#include "palpate/servo/burr_rendering.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate {
namespace {

constexpr const BurrRenderingSettings& kRendering = kBurrRenderingSettings;

}  // namespace

double vibration_hz(const BurrSettings& burr, double dt_s) {
  const double band_hz = std::min(kRendering.max_hz, kRendering.max_cycles_per_tick / dt_s);
  const double edges_hz = burr.revolutions_per_s * burr.flutes;
  if (edges_hz <= band_hz) return edges_hz;
  return burr.revolutions_per_s / std::ceil(burr.revolutions_per_s / band_hz);
}

double vibration_amplitude_N(const BurrSettings& burr, const BurrState& state, double hz) {
  const bool cuts = state.front_mm2 > 0 && state.edge_speed_mm_s > 0 && state.energy_mJ_per_mm3 > 0 &&
                    std::isfinite(state.energy_mJ_per_mm3);
  if (!cuts || !(hz > 0)) return 0;
  const double cutting_N = burr.grip * state.pressed_N;
  const double feed_speed_mm_s =
      cutting_N * state.edge_speed_mm_s / (state.energy_mJ_per_mm3 * state.front_mm2);
  // an edge's passing, or a revolution of which the rendered frequency is a sub-harmonic
  const double real_hz = std::max(hz, burr.revolutions_per_s);
  const double depth_mm = feed_speed_mm_s / real_hz;
  return cutting_N * kRendering.runout_mm / (kRendering.runout_mm + depth_mm);
}

double bone_rise_K(double rise_K, double radius_mm, double work_mJ, double dt_s) {
  const double conductivity_mW_per_mm_K = kRendering.conductivity_W_per_m_K;
  const double resistance_K_per_mW = 1 / (2 * std::numbers::pi * conductivity_mW_per_mm_K * radius_mm);
  const double time_s = radius_mm * radius_mm * kRendering.capacity_mJ_per_mm3_K / conductivity_mW_per_mm_K;
  const double heated_K = kRendering.heat_fraction * work_mJ * resistance_K_per_mW / time_s;
  return std::max(0.0, rise_K * std::exp(-dt_s / time_s) + heated_K);
}

}  // namespace palpate
