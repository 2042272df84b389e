#pragma once

#include <span>

#include "palpate/servo/servo.h"

namespace palpate {

/// Changes since the proxy's last tick.
struct ProxyChange {
  bool surfaces_changed = false;  ///< Whether the proxy was last advanced on another version of the model
  /// Correspondence of each of the model's surfaces to those of that version; empty: unknown, all are new.
  std::span<const SurfaceCorrespondence> correspondences;
  bool layers_reassigned = false;  ///< Whether structures were assigned to other layers
  /// Whether a direct method pushed the tip in the last tick. The proxy of a tip inside tissue is then
  /// initialised; otherwise it stays uncoupled until the tip is in free space.
  bool was_pushed_directly = false;
  CarvedMaterial carved = {};  ///< Material that the burr's sweeps have removed from the surfaces
};

/// State of a burr's motor in one tick.
struct MotorState {
  bool runs = false;
  double max_press_N = 0;  ///< Upper bound of the press force: the force that can be rendered, in the patient
  std::uint32_t stroke = 0;  ///< Number of the stroke to which the burr's sweeps belong
};

/// Contact of a tool by the proxy method. Advances the proxy, and a burr also removes the material that it
/// touches.
ToolContact advance_tool(const TickContext& tick, const DeviceContext& context, const ProxyChange& change,
                         const MotorState& motor, SessionState::DeviceSession& session);

/// Adds the force that pushes the tool out of no-go regions; for a burr, its head with the full radius. Only
/// the excess of that force over the contact force in the same direction is added. Contact and region
/// together are therefore no stiffer than the stiffer of the two, and the force has no step where a region
/// begins. Records the added force and the structures near the tool in `out`.
void add_no_go_force(const TickContext& tick, const DeviceContext& context, ToolContact& contact,
                     DeviceTick& out);

}  // namespace palpate
