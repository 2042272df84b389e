#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "palpate/palpation/scripted_hand.h"

/// Constants and functions that several sources of ScriptedHand use.
namespace palpate::scripted_hand {

/// Maximum speed of the hand while it presses.
inline constexpr double kMaxPressing_mm_s = 12;
/// Speed of withdrawals along the path.
inline constexpr double kWithdrawing_mm_s = 60;
/// Force that counts as free.
inline constexpr double kFree_N = 0.02;
/// Distance between tip and commanded position, beyond force and tracking tolerance, at which the hand gives
/// up.
inline constexpr double kPushedAway_mm = 4;
/// Time without progress after which the hand counts as stuck.
inline constexpr double kStuck_s = 1;

/// As std::printf; longer texts are truncated to 199 characters.
std::string text_of(const char* format, ...) __attribute__((format(printf, 1, 2)));
/// Coordinates to 0.1 mm, "1.0, 2.5, -3.0 mm".
inline std::string position_text(const Point<Patient>& p) {
  return text_of("%.1f, %.1f, %.1f mm", p.x(), p.y(), p.z());
}

template <class Frame>
Point<Frame> point(const std::array<double, 3>& p) {
  return {p[0], p[1], p[2]};
}

/// Tip of the first device.
inline Point<World> tip_of(const TickRecord& tick) {
  return point<World>(tick.device[0].tip_world_mm);
}

/// Force clamped to the force limit of that tick; a tick with a fault has none.
inline double limited(double force_N, const TickRecord& tick) {
  const double limit_N = tick.device[0].limit_N;
  return limit_N > 0 ? std::min(force_N, limit_N) : force_N;
}

/// Whether the force of the tick is that of the proxy.
inline bool is_rendered_by_proxy(const TickRecord& tick) {
  return tick.method == static_cast<std::uint8_t>(ForceMethod::kProxy) &&
         (tick.device[0].flags & kFlagMethodMissing) == 0;
}

/// Whether a force deviates from the requested one by at most this fraction of it.
inline bool is_within(double force_N, double requested_N, double fraction) {
  return std::abs(force_N - requested_N) <= fraction * requested_N;
}

}  // namespace palpate::scripted_hand
