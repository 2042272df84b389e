#pragma once

#include <array>

#include "palpate/proxy.h"

namespace palpate {

/// The corners of a proxy's way in one tick, for who looks whether it went through something.
struct ProxyWay {
  std::array<Point<Patient>, 128> corner;
  std::size_t count = 0;

  void add(const Point<Patient>& next) {
    if (count < corner.size()) corner[count++] = next;
  }
};

/// As palpate/proxy.h, and tells its way.
ProxyResult advance_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                          const Point<Patient>& tip, ProxyState& state, const ProxyOptions& options,
                          ProxyWay* way);

}  // namespace palpate
