#pragma once

#include "palpate/geometry/geometry.h"
#include "palpate/haptics/bounce.h"

/// Time-domain passivity (Hannaford & Ryu 2002): what is felt gives the hand no more energy than the hand has
/// put in. docs/concepts/passivity.md has the choices.
namespace palpate {

/// What the passivity observer remembers of one device.
struct PassivityState {
  double energy_mJ = 0;  ///< that the hand has put in and not got back; below 0: it got more
  // the way along the force since a speed was told last, its time, and that speed
  double way_mm = 0, time_s = 0, speed_mm_s = 0;
  // how far within less than a step of its encoder the tip is, and whether it went with the force last
  double play_mm = 0;
  bool gives_way = false;
  BounceState bounce;
};

struct PassivityInput {
  Vector<World> force_N;          ///< asked, as far as limit and ramp let it through
  double unlimited_N = 0;         ///< that force without the limit
  Vector<World> acted_N;          ///< since the tick before
  Vector<World> way_mm;           ///< of the tip since then, relative to the object, mm of the device
  double stored_mJ = 0;           ///< that the contact can hold now, as a spring does; infinite: not known
  double stiffness_N_per_mm = 0;  ///< of the contact, at the device
  double step_mm = 0;             ///< of the encoders; not known: that of a coarse one
  double dt_s = 0;
  double pending_N_s = 0;            ///< along the force: sent and not acted yet
  double delay_s = 0;                ///< from a command to its force, as late as it is taken to be
  Vector<World> velocity_mm_s = {};  ///< of the tip relative to the object, mean of 10 ms, mm of the device
};

/// What the controller takes off the asked force: most of it by a damper along the force.
struct PassivityOutput {
  double factor = 1;             ///< by which force and torque are multiplied, 0 ... 1
  double damping_N_s_per_m = 0;  ///< of that damper; 0: it does not act
};

/// Observer: counts what the way cost the hand, as work of the force that was really sent over the true way.
/// The sum over the axes: a force that only changes its direction, as around a ball, takes from one axis what
/// it gives to another.
///
/// Controller: where the energy does not cover what the force would give out if the tip went on as it does,
/// a damper along the force takes off what is not covered. It acts on forces that push the tip on its way and
/// never turns one round. A tip too slow for its speed to be known is let out with less force than it was let
/// in, by an encoder step's worth at most, where the energy does not cover two. A wall so stiff that the tip
/// bounces within a single step of the encoder is softer for as long as energy is owed. A tip that fell on it
/// is not thrown out faster than it came (bounce.h).
/// @param act  false: observes only
PassivityOutput keep_passive(const PassivityInput& input, bool act, PassivityState& state);

}  // namespace palpate
