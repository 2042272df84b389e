#pragma once

#include "palpate/base/result.h"
#include "palpate/volume/volume.h"

namespace palpate {

/// Ranges of a grid from which a model is made: voxels along an axis, spacing, and distance of the origin
/// from the patient's along each axis.
inline constexpr int kMaxGridVoxels = 1 << 20;
inline constexpr double kMinSpacing_mm = 1e-4, kMaxSpacing_mm = 1e3, kMaxOrigin_mm = 1e6;
/// Checks dimensions, spacing, direction and origin of a grid. Errors: kBadInput with the name of the member
/// as location.
Result<void> check_grid(const GridGeometry& grid);

}  // namespace palpate
