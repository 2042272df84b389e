#pragma once

#include <string>

#include "palpate/base/progress.h"
#include "palpate/device/simulated_device.h"
#include "palpate/device/workspace.h"
#include "palpate/haptics/haptics.h"
#include "palpate/stability/stability.h"

namespace palpate {

/// What a hand holds with the first device of a session, and what a scene asks of it. N/mm of the device.
struct HeldStiffness {
  /// By the stiffest tissue, scale and gain of the workspace included; by a direct method of all points of
  /// the tool together.
  double asked_N_per_mm = 0;
  /// recommended_stiffness_N_per_mm, or less that is known to be held; what the device's maker vouches for
  /// where that is less still.
  double most_N_per_mm = 0;
  /// What is clamped, in words with the numbers; empty: nothing is.
  std::string clamped;
};

/// Looks for the recommended stiffness only where more is asked than theory alone promises, by whatever
/// method, which takes half a second. Errors: kInterrupted.
/// @param method  that is felt at first
Result<HeldStiffness> held_stiffness(const Model& model, const WorkspaceSettings& workspace,
                                     ForceMethod method, const PlantDevice& device, double rate_hz,
                                     double delay_s, const Progress& progress = {});

/// The same of damping, N s/mm of the device: by the most viscous tissue, or by the coupling of the proxy
/// where that is more.
struct HeldDamping {
  double most_N_s_per_mm = 0;  ///< recommended_damping_N_s_per_mm
  std::string clamped;         ///< as above
};
HeldDamping held_damping(const Model& model, const WorkspaceSettings& workspace, const PlantDevice& device,
                         double rate_hz, double delay_s);

}  // namespace palpate
