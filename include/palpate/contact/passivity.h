#pragma once

#include "palpate/contact/rebound.h"
#include "palpate/geometry/geometry.h"

/// Time-domain passivity observer and controller (Hannaford & Ryu 2002): the rendered environment returns no
/// more energy to the operator than was put in. For the choices see docs/concepts/passivity.md.
namespace palpate {

/// State of the passivity observer and controller of one device.
struct PassivityState {
  double energy_mJ = 0;  ///< Energy put in by the operator and not yet returned; negative: more was returned
                         ///< than put in
  // velocity estimate along the force: displacement and time since the last estimate, and that estimate
  double displacement_mm = 0, time_s = 0, speed_mm_s = 0;
  // direction along the force, with hysteresis: displacement within the dead band, and whether the tip last
  // moved along the force
  double dead_band_mm = 0;
  bool moves_with_force = false;
  ReboundState rebound;
};

/// Inputs of control_passivity() for one tick.
struct PassivityInput {
  Vector<World> force_N;         ///< Requested force, after force limit and ramp
  double unlimited_N = 0;        ///< Magnitude of that force without the limit
  Vector<World> acting_force_N;  ///< Force that acted since the last tick
  /// Displacement of the tip since then, relative to the object; mm of the device
  Vector<World> displacement_mm;
  double stored_mJ = 0;  ///< Elastic energy that the contact stores now, an upper limit; infinite: unknown
  double stiffness_N_per_mm = 0;  ///< Contact stiffness at the device
  double encoder_step_mm = 0;     ///< Encoder step; 0: unknown, that of a coarse encoder is assumed
  double dt_s = 0;
  double pending_N_s = 0;  ///< Impulse along the force that was sent and has not acted yet
  double delay_s = 0;      ///< Assumed delay from a command to its force
  /// Velocity of the tip relative to the object, mean of 10 ms; mm/s of the device.
  Vector<World> velocity_mm_s = {};
  double received_mJ = 0;  ///< Work that other tools have done on the contact since the last tick
};

/// Reduction of the requested force by the controller, mainly by a damper along the force.
struct PassivityOutput {
  double factor = 1;             ///< Factor for force and torque, 0 ... 1
  double damping_N_s_per_m = 0;  ///< Coefficient of the damper. 0: inactive
};

/// Observer: integrates the work of the force that actually acted over the true displacement. The energy is
/// the sum over the axes, because a force that only rotates, as around a ball, transfers energy from one axis
/// to another.
///
/// Controller: if the energy does not cover what the force would give out in the next tick at the current
/// velocity, a damper along the force removes the uncovered part. It acts only while the force pushes the tip
/// along its motion, and never reverses a force. For a tip too slow for a velocity estimate, the force is
/// reduced during withdrawal where the energy does not cover two encoder steps, by at most the force of one
/// step. While the energy is negative, the force is reduced on a contact so stiff that the tip would bounce
/// within a single encoder step. A falling tip does not rebound faster than its impact speed (rebound.h).
/// @param act  false: observer only
PassivityOutput control_passivity(const PassivityInput& input, bool act, PassivityState& state);

}  // namespace palpate
