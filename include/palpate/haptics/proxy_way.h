#pragma once

#include <array>

#include "palpate/haptics/proxy.h"

namespace palpate {

/// The corners of a proxy's way in one tick, for who looks whether it went through something. Between two it
/// goes straight and turns evenly.
struct ProxyWay {
  std::array<Point<Patient>, 192> corner;
  std::array<Eigen::Quaterniond, 192> attitude;
  std::size_t count = 0;

  void add(const Point<Patient>& next, const Eigen::Quaterniond& turned) {
    if (count == corner.size()) return;
    corner[count] = next;
    attitude[count++] = turned;
  }
};

/// As palpate/haptics/proxy.h, and tells its way.
ProxyResult advance_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& hand, ProxyState& state, const ProxyOptions& options,
                          ProxyWay* way);

}  // namespace palpate
