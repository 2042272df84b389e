#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/volume/volume.h"

namespace palpate {

/// Mask of the voxels inside the body, 1 or 0 each, i fastest. The body consists of the labelled voxels and,
/// with a scan, of all voxels connected to them by faces through voxels of at least `air_below`. Cavities
/// are included if they are enclosed in space or within a slice perpendicular to the grid axis nearest to
/// the patient's longitudinal axis.
/// @param labels     flattened, 0: unlabelled
/// @param scan       on the same grid; may be null
/// @param air_below  scan value that separates air from the body; only with a scan
/// Errors: kInterrupted.
Result<std::vector<std::uint8_t>> body_mask(const Volume<LabelId>& labels, const Volume<float>* scan,
                                            std::optional<double> air_below, const Progress& progress = {});

}  // namespace palpate
