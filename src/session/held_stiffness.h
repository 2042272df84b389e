#pragma once

#include <optional>
#include <string>

#include "palpate/haptics.h"
#include "palpate/progress.h"
#include "palpate/simulated_device.h"
#include "palpate/stability.h"
#include "palpate/workspace.h"

namespace palpate {

/// What a hand holds with a device, and what a scene asks of it. N/mm of the device.
struct HeldStiffness {
  double asked_N_per_mm = 0;  ///< by the stiffest tissue, scale and gain of the workspace included
  double most_N_per_mm = 0;   ///< recommended_stiffness_N_per_mm, or less that is known to be held
  /// What is clamped, in words with the numbers; empty: nothing is.
  std::string clamped;
};

/// Looks for the recommended stiffness only where more is asked than theory alone promises, which takes half
/// a second. Errors: kInterrupted.
Result<HeldStiffness> held_stiffness(const Model& model, const WorkspaceSettings& workspace,
                                     const PlantDevice& device, double rate_hz, double delay_s,
                                     const Progress& progress = {});

}  // namespace palpate
