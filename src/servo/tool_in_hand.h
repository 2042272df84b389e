#pragma once

#include <span>

#include "palpate/servo/servo.h"

namespace palpate {

/// What has changed since the last tick of the proxy.
struct ProxyChange {
  bool surfaces = false;                  ///< it is on those of another version of the model
  std::span<const SurfaceBefore> before;  ///< these, one for each of the model's
  bool layers = false;                    ///< structures lie in other layers of them
  bool method = false;       ///< a direct method pushed until now: where the tip is inside, a proxy is born
  std::uint64_t carved = 0;  ///< so many sweeps of the tool's burr are taken from the surfaces
};

/// What runs a burr in a tick.
struct MotorState {
  bool runs = false;
  double most_press_N = 0;   ///< in the patient
  std::uint32_t stroke = 0;  ///< of what it cuts
};

/// What a tool meets by the proxy, which remembers where it is, and as a burr, which takes away what it
/// touches.
ToolContact advance_tool(const TickContext& tick, const HandContext& context, const ProxyChange& change,
                         const MotorState& motor, SessionState::Hand& hand);

/// Pushes the tool out of the no-go regions, a burr with its whole head, beside what it leans on. Along the
/// way out of the regions it pushes with what the contact lacks of their force and with no more: so the two
/// together are never stiffer than the stiffer one, and the force has no step where one of them begins. Tells
/// of it and of the structures that are near, in `out`.
void keep_away(const TickContext& tick, const HandContext& context, ToolContact& contact, DeviceTick& out);

}  // namespace palpate
