#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// How long each hand explores, and presses.
struct CuttingTimes {
  double explored_s = 20, pressed_s = 4;
};
/// What the simulated hands get from a burr while it cuts a plane of bone, at the stiffness that is
/// recommended for their device: energy that is given out, and whether a hand that presses swings; with
/// limits. Errors: kInterrupted.
Result<std::vector<Figure>> cutting_plants_figures(const CuttingTimes& times, const Progress& progress);

}  // namespace palpate
