#pragma once

#include <cstdint>

#include "palpate/servo/servo.h"

/// Output stage: the last step before a device. Every wrench passes through it.
namespace palpate {

/// Requested wrench and the conditions under which it may be sent.
struct OutputRequest {
  Wrench requested;          ///< Requested wrench, gains applied
  double age_s = 0;          ///< Age of the state; not finite or below -clock_jitter_s: no state at all
  std::uint32_t faults = 0;  ///< TickFlag bits of kFaultFlags
  bool fade_out = false;     ///< Whether the force fades out and stays off: paused or clutched
  double unclamped_N = 0;    ///< Magnitude of the requested force before any reduction, for the record
};

/// Wrench to send, and the TickFlag bits that state why it differs from the request.
struct Output {
  Wrench wrench;
  std::uint32_t flags = 0;
  double limit_N = 0;  ///< Force limit of this tick, thermal limit included
};

/// Steps, in order: faults and stale states zero the output at once; force limit; ramp; slew; force limit
/// again; decay of a stale state.
///
/// After a fault the force returns by the ramp. After a short dropout a limited slew suffices; the ramp
/// would leave a pressing hand unsupported for half a second. Only one dropout within the ramp's duration
/// counts as short: if poses arrive intermittently, it is unknown whether more will follow. The limit keeps
/// the force's direction and scales the torque by the same factor. It precedes the ramp, so that fading
/// starts from the force that was rendered, and follows the slew, so that no tick exceeds it however fast it
/// was lowered.
///
/// @param max_force_N  the user's limit; not finite or negative counts as 0
/// @param dt_s         time since the last call; not finite or negative counts as 0
Output make_output(const OutputRequest& request, const OutputLimits& limits, double max_force_N, double dt_s,
                   OutputState& state);

/// Force limit that the next call would apply, thermal limit included; N.
double next_limit_N(const OutputLimits& limits, double max_force_N, double dt_s, const OutputState& state);

}  // namespace palpate
