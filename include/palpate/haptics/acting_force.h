#pragma once

#include <array>

#include "palpate/geometry/geometry.h"

namespace palpate {

/// What was sent and has not acted yet, as far as a device's delay is known. Oldest first.
struct DelayLine {
  struct Held {
    Vector<World> force_N;
    double time_s = 0;
  };
  std::array<Held, 64> held;
  int count = 0;
  bool forgot = false;  ///< something was sent before the oldest of them
};

/// The mean force that has acted on the device since the last tick, where what is sent acts after a delay.
/// Each command is held until the next one comes. Where the delay has grown, or is longer than the line, the
/// oldest command stands for those that were forgotten.
/// @param sent_N  what the last tick sent, `dt_s` ago; joins the line
Vector<World> follow_delay(const Vector<World>& sent_N, double dt_s, double delay_s, DelayLine& line);

/// N s along a direction: what has been sent and has not acted yet.
double still_to_act_N_s(const DelayLine& line, const Vector<World>& along, double delay_s);

}  // namespace palpate
