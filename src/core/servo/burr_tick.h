#pragma once

#include "palpate/servo/servo.h"

/// Rendering of a burr within a tick: laws of palpate/servo/burr_rendering.h.
namespace palpate {

/// State of a burr before the tick advances it.
struct BurrBefore {
  Point<Patient> at;     ///< Position of the head in the layer in which it cut
  Vector<Patient> push;  ///< Direction in which the hand pressed the head, unit; zero: no contact
  double front_mm2 = 0;  ///< BurrState::front_mm2
  double pressed_N = 0;  ///< BurrState::pressed_N
  double work_mJ = 0;    ///< BurrState::work_mJ
};
BurrBefore before_cutting(const SessionState::DeviceSession& session);

/// Conditions under which a burr is rendered.
struct BurrConditions {
  BurrBefore before;
  bool runs = false;      ///< Whether the motor runs
  bool vibrates = false;  ///< Settings::vibration
  double limit_N = 0;     ///< Force limit of this tick, at the device
};

/// Adds vibration and kick to the force requested by a burr's contact, and records them with load, local
/// cutting energy, break-through and temperature rise.
///
/// Both forces act along the direction in which the head would roll on the surface, rotation vector x contact
/// normal. Together they never exceed the force limit that the contact leaves, nor the force whose work over
/// two encoder steps is covered by the energy that the operator has put in; a contact that owes energy, or
/// none, gets neither.
void render_burr(const TickContext& tick, const DeviceContext& context, const BurrConditions& conditions,
                 ToolContact& contact, SessionState::DeviceSession& session, DeviceTick& out);

}  // namespace palpate
