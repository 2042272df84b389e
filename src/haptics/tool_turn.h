#pragma once

#include <span>

#include "palpate/haptics/proxy.h"
#include "palpate/haptics/proxy_way.h"

namespace palpate {

/// How a turn of the tool went.
struct ToolTurn {
  bool lagging = false;  ///< farther than one tick's work follows; it goes on in the next
  bool blocked = false;  ///< walls leave the tool no place where it would turn on to
};

/// Turns a layer's proxy with its tool about the tip from its attitude towards another, along the shorter
/// arc, and puts the proxy back outside of what the tool turns into: the attitude is the hand's, the place
/// yields. In steps, between whose ends no sphere lies deeper than ProxyFeel::most_dip_mm. Where the place
/// cannot yield, the attitude stays behind. Bounded work; allocates, locks and throws nothing.
/// @param spheres  as `attitude` turns them
/// @param way      gets the end of every step; may be null
ToolTurn turn_tool(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres, int layer,
                   const Eigen::Quaterniond& attitude, ProxyLayer& state, ProxyWay* way);

}  // namespace palpate
