#pragma once

#include <cstdint>

#include "palpate/servo/servo.h"

/// The last stage before a device, and the only way to it.
namespace palpate {

struct OutputRequest {
  Wrench asked;              ///< already multiplied by the gains
  double age_s = 0;          ///< of its state; not finite or below -clock_jitter_s: no state at all
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
