#pragma once

#include <span>

#include "palpate/contact/proxy.h"

/// Return of the tool to free space: a layer constrains the tool only while the tool is in the tissue that
/// the layer covers (docs/decisions/0076-layers-hold-while-covered.md).
namespace palpate {

/// Whether the layer's proxy coincides with the operator's pose without contact.
inline bool coincides_with(const ProxyLayer& layer, const ToolPose& hand) {
  return layer.contact_count == 0 && layer.attitude.coeffs() == hand.attitude.coeffs() &&
         (hand.tip - layer.position).norm() <= kProxySettings.arrived_mm;
}

/// Whether the tool is back in free space on the side from which contact began. The remaining contacts then
/// hold it from elsewhere, e.g. a pocket into which the proxy was pressed.
bool has_withdrawn(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                   const ToolPose& hand, ProxyState& state);

}  // namespace palpate
