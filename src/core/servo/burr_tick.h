#pragma once

#include "palpate/servo/servo.h"

/// Rendering of a burr within a tick: laws of palpate/servo/burr_rendering.h.
namespace palpate {

/// State of a burr before the tick advances it.
struct BurrSnapshot {
  Point<Patient> at;  ///< Position of the head in the layer in which it cut
  /// Direction in which the operator pressed the head, unit; zero: no contact.
  Vector<Patient> press_direction;
  double front_mm2 = 0;  ///< BurrState::front_mm2
  double pressed_N = 0;  ///< BurrState::pressed_N
  double work_mJ = 0;    ///< BurrState::work_mJ
};
BurrSnapshot burr_snapshot(const SessionState::DeviceSession& session);

/// Conditions under which a burr is rendered.
struct BurrConditions {
  BurrSnapshot before;
  bool runs = false;      ///< Whether the motor runs
  bool vibrates = false;  ///< Settings::vibration
  double limit_N = 0;     ///< Force limit of this tick, at the device
};

/// Adds vibration and kick to the force requested by a burr's contact, and records them with load, local
/// cutting energy, break-through and temperature rise.
///
/// Both forces act along the direction in which the head would roll on the surface, rotation vector x contact
/// normal. Together they never exceed the force limit that the contact leaves, nor the force whose work over
/// two encoder steps is covered by the energy that the operator has put in. Without a contact, or if that
/// energy is not positive, both are zero.
void render_burr(const TickContext& tick, const DeviceContext& context, const BurrConditions& conditions,
                 ToolContact& contact, SessionState::DeviceSession& session, DeviceTick& out);

}  // namespace palpate
