#pragma once

#include <array>
#include <cstdint>

namespace palpate {

/// Volume that a burr swept along a short straight path, in the patient (Sweep, palpate/tissue/sweep.h).
struct SweepRecord {
  /// Device of a removed fragment that a burr had cut loose.
  static constexpr std::uint32_t kBrokenOff = 0xffffffff;
  std::uint32_t device = 0;  ///< Device that drove the burr, or kBrokenOff
  std::array<double, 3> from_mm{}, to_mm{};
  double radius_mm = 0;
  std::uint32_t stroke = 0;  ///< Stroke number, counted from the motor's first start
  /// Axis vector of a cylinder or cone, and the radius at its end; 0: ball.
  std::array<double, 3> axis_mm{};
  double end_radius_mm = 0;

  friend bool operator==(const SweepRecord&, const SweepRecord&) = default;
};

}  // namespace palpate
