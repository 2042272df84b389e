#pragma once

#include <string>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/device/simulated_device.h"
#include "palpate/device/workspace.h"
#include "palpate/stability/stability.h"

namespace palpate {

/// Stiffness that a simulated hand can hold stably with the first device of a session, compared with what the
/// scene requests. In N/mm at the device.
struct LimitedStiffness {
  /// Requested stiffness of the stiffest tissue, including the workspace's scale and gain; for a direct
  /// method, of all points of the tool together.
  double requested_N_per_mm = 0;
  /// Limit: recommended_stiffness_N_per_mm, or a lower value known to be stable; at most the vendor's
  /// specification.
  double max_N_per_mm = 0;
  /// Description of what is clamped, with numbers; empty: nothing.
  std::string clamped;
};

/// Computes the recommended stiffness, which takes half a second, only if more is requested by any method
/// than the theoretical bound guarantees. Errors: kInterrupted.
/// @param method  initial force method
Result<LimitedStiffness> limited_stiffness(const Model& model, const WorkspaceSettings& workspace,
                                           ForceMethod method, const PlantDevice& device, double rate_hz,
                                           double delay_s, const Progress& progress = {});

/// The same for damping, N s/mm at the device: of the most viscous tissue, or of the proxy's coupling if that
/// is larger.
struct LimitedDamping {
  double max_N_s_per_mm = 0;  ///< recommended_damping_N_s_per_mm
  std::string clamped;        ///< Description of what is clamped; empty: nothing
};
LimitedDamping limited_damping(const Model& model, const WorkspaceSettings& workspace,
                               const PlantDevice& device, double rate_hz, double delay_s);

}  // namespace palpate
