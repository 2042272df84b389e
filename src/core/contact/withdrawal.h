#pragma once

#include <span>

#include "palpate/contact/proxy.h"

/// Return of the tool to free space: a layer constrains the tool only while the tool is in the tissue that
/// the layer covers (docs/decisions/0076-layers-hold-while-covered.md).
namespace palpate {

/// Whether the layer's proxy coincides with the operator's pose without contact.
inline bool coincides_with(const ProxyLayer& layer, const ToolPose& tool_pose) {
  return layer.contact_count == 0 && layer.attitude.coeffs() == tool_pose.attitude.coeffs() &&
         (tool_pose.tip - layer.position).norm() <= kProxySettings.arrived_mm;
}

/// Whether the tool is back in free space on the side from which contact began. Any remaining contacts then
/// constrain the proxy elsewhere, e.g. in a pocket into which it was pressed.
bool has_withdrawn(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                   const ToolPose& tool_pose, ProxyState& state);

}  // namespace palpate
