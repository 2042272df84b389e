#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Plane of bone of 1 N/mm, and a ball burr of 4 mm. Errors: kInterrupted.
Result<Model> wall_for_burr(const Progress& progress = {});

/// Durations for which each hand explores, presses, and presses until the burr has almost reached its target
/// depth.
struct CuttingTimes {
  double explored_s = 20, pressed_s = 4, settled_s = 16;
};
/// Simulated hands with a burr that cuts a plane of bone, at the stiffness recommended for their device:
/// energy generated, and oscillation of a pressing hand while the burr sinks in, after it has, and in its
/// hole with the motor off; with limits. Errors: kInterrupted.
Result<std::vector<Figure>> cutting_plants_figures(const CuttingTimes& times, const Progress& progress);

}  // namespace palpate
