#pragma once

#include <span>

#include "palpate/servo/servo.h"

namespace palpate {

/// Changes since the proxy's last tick.
struct ProxyChange {
  bool surfaces = false;  ///< The proxy is on surfaces of another version of the model
  std::span<const SurfaceCorrespondence> before;  ///< Correspondence of each of the model's surfaces to those
  bool layers = false;                            ///< Structures belong to other layers
  /// A direct method pushed in the last tick: initialise the proxy if the tip is inside
  bool method = false;
  std::uint64_t carved = 0;  ///< Number of the tool's sweeps that have been carved from the surfaces
};

/// State of a burr's motor in one tick.
struct MotorState {
  bool runs = false;
  double max_press_N = 0;    ///< Largest press force that the burr may assume, in the patient
  std::uint32_t stroke = 0;  ///< Stroke that its sweeps belong to
};

/// Contact of a tool by the proxy method. Advances the proxy, and a burr also removes the material that it
/// touches.
ToolContact advance_tool(const TickContext& tick, const DeviceContext& context, const ProxyChange& change,
                         const MotorState& motor, SessionState::Hand& hand);

/// Adds the force that pushes the tool out of no-go regions; for a burr, its whole head. Along the direction
/// out of the regions, only the part of their force that the contact does not already provide is added:
/// together they are no stiffer than the stiffer of the two, and the force has no step where a region begins.
/// Records this force and the structures near the tool in `out`.
void keep_away(const TickContext& tick, const DeviceContext& context, ToolContact& contact, DeviceTick& out);

}  // namespace palpate
