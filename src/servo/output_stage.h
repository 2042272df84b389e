#pragma once

#include <cstdint>

#include "palpate/servo/servo.h"

/// The last stage before a device, and the only way to it.
namespace palpate {

inline constexpr double kFresh_s = 5e-3;   ///< a state of up to this age is acted on in full
inline constexpr double kStale_s = 10e-3;  ///< one of this age gets nothing
/// A dropout: poses that have been no older than this come back faster than by the ramp.
inline constexpr double kShortDropout_s = 20e-3;
/// So fast the force grows then, and no faster for so long: 0.2 N in a tick of 1 kHz is no kick. 9 N, more
/// than any known device has, are back in 50 ms; the rest is for the hand's rebound. A hand that lost its
/// support sinks the less the faster it comes back.
inline constexpr double kReturn_N_per_s = 180, kReturn_s = 100e-3;
/// A state from the future comes from another clock; by so much, it is one that is set to ours.
inline constexpr double kClockJitter_s = 1e-3;
/// Time constant of the motors' warming. An assumption: the makers give a continuous force and a peak, and
/// the windings of small ironless motors warm within some ten seconds (docs/decisions/0008).
inline constexpr double kThermal_s = 10;
/// The last of the budget is spent over this time, so that the limit sinks and does not drop.
inline constexpr double kThermalTaper_s = 0.2;
/// Torque and gripper may change by their whole range in this time.
inline constexpr double kFullSwing_s = 10e-3;

struct OutputRequest {
  Wrench asked;      ///< already multiplied by the gains
  double age_s = 0;  ///< of the state it answers; not finite or below -kClockJitter_s: no state at all
  std::uint32_t faults = 0;  ///< TickFlag bits out of kFaultFlags
  bool off = false;          ///< fade out: paused, clutched
  double unclamped_N = 0;    ///< what was asked before anything was taken off, for the record
};

/// What goes to the device, and why it differs from what was asked (TickFlag bits).
struct Output {
  Wrench wrench;
  std::uint32_t flags = 0;
  double limit_N = 0;  ///< of the force in this tick, thermal limit included
};

/// In order: faults and stale states give nothing, at once; limit; ramp; slew; limit again; decay of an
/// ageing state. What was lost comes back by the ramp, after a short dropout by a slow slew: then nothing is
/// wrong, and a hand that presses would fall for half a second. Only one dropout in the ramp's time is that:
/// of poses that come now and then nobody knows whether they are all there is. The limit keeps the direction
/// and scales the torque alike; it stands before the ramp, so that what fades is what was felt, and after the
/// slew, so that no tick is above it, however fast it was lowered.
/// @param max_force_N  the user's limit; not finite or negative counts as 0
/// @param dt_s         since the last call; not finite or negative counts as 0
Output make_output(const OutputRequest& request, const OutputLimits& limits, double max_force_N, double dt_s,
                   OutputState& state);

/// The limit of force that the next call would keep, thermal limit included; N.
double next_limit_N(const OutputLimits& limits, double max_force_N, double dt_s, const OutputState& state);

}  // namespace palpate
