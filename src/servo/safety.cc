#include "servo/safety.h"

#include <cmath>

#include "palpate/telemetry.h"

namespace palpate {

SafeWrench make_safe(const Wrench& asked, double max_force_N, bool paused) {
  if (paused) return {{}, kFlagPaused};
  if (!asked.force_N.all_finite() || !asked.torque_Nmm.all_finite()) return {{}, kFlagNotFinite};

  // scaled down first, so that the square of a huge force does not overflow
  const double largest = asked.force_N.eigen().cwiseAbs().maxCoeff();
  const double magnitude = largest > 0 ? largest * (asked.force_N / largest).norm() : 0;
  const double limit = max_force_N > 0 && std::isfinite(max_force_N) ? max_force_N : 0;
  if (magnitude <= limit) return {asked, 0};

  // a hair below the limit, so that rounding never lifts the norm above it
  const double scale = limit / largest / (magnitude / largest) * (1 - 0x1p-50);
  return {{asked.force_N * scale, asked.torque_Nmm * scale}, kFlagClamped};
}

}  // namespace palpate
