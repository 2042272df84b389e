#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// How long each hand explores, presses, and presses until the burr has all but come to where it is wanted.
struct CuttingTimes {
  double explored_s = 20, pressed_s = 4, settled_s = 16;
};
/// What the simulated hands get from a burr while it cuts a plane of bone, at the stiffness that is
/// recommended for their device: energy that is given out, and whether a hand that presses swings, while the
/// burr sinks in, when it has, and in its hole with the motor off; with limits. Errors: kInterrupted.
Result<std::vector<Figure>> cutting_plants_figures(const CuttingTimes& times, const Progress& progress);

}  // namespace palpate
