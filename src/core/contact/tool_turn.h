#pragma once

#include <span>

#include "palpate/contact/proxy.h"
#include "palpate/contact/proxy_path.h"

namespace palpate {

/// Result of rotating a proxy's tool by one tick.
struct ToolTurn {
  bool lagging = false;  ///< The rotation exceeds the work limit of a tick and continues in the next
  bool blocked = false;  ///< Surfaces leave no position outside for the tool in a further rotated attitude
};

/// Rotates a layer's proxy about the tip towards an attitude, along the shorter arc, and pushes its position
/// out of surfaces that the tool rotates into: the attitude has priority over the position. Swept in steps;
/// between the ends of a step no sphere penetrates deeper than ProxySettings::max_penetration_mm. If no free
/// position is found, the attitude lags behind. Bounded work; does not allocate, lock or throw.
/// @param parts     tool parts in `attitude`
/// @param attitude  target attitude
/// @param state     proxy of the layer, updated
/// @param path      receives the pose after every step; may be null
ToolTurn turn_tool(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
                   const Eigen::Quaterniond& attitude, ProxyLayer& state, ProxyPath* path);

}  // namespace palpate
