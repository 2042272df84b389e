#pragma once

#include <array>

#include "palpate/geometry/geometry.h"

namespace palpate {

/// Delay line of the commands that have not acted yet, oldest first, for a device whose delay is known.
struct DelayLine {
  /// A command and the time for which it was held.
  struct Sample {
    Vector<World> force_N;
    double time_s = 0;
  };
  std::array<Sample, 64> samples;
  int count = 0;               ///< Number of valid entries of `samples`
  bool dropped_older = false;  ///< Whether older commands were dropped from the line
};

/// Mean force that acted on the device since the last tick, with each command acting after a delay and held
/// until the next. If the delay has increased, or exceeds the length of the line, the oldest command
/// substitutes for those that were dropped.
/// @param sent_N   command of the last tick, sent dt_s ago; appended to the line
/// @param dt_s     length of the last tick
/// @param delay_s  delay from a command to its force
/// @param line     updated
Vector<World> advance_delay_line(const Vector<World>& sent_N, double dt_s, double delay_s, DelayLine& line);

/// Impulse along a direction of the commands that have not acted yet; N s.
double pending_impulse_N_s(const DelayLine& line, const Vector<World>& along, double delay_s);

}  // namespace palpate
