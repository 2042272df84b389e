#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/volume/volume.h"

namespace palpate {

/// Which voxels lie inside the body, 1 or 0 each, i fastest. The body is what is labelled and, with a scan,
/// all that is connected to it by faces through voxels of at least `air_below`; then whatever that encloses
/// in space or within a slice of the grid's axis that is nearest to the patient's.
/// @param labels     flattened, 0: unlabelled
/// @param scan       on the same grid; may be null
/// @param air_below  value of the scan that parts air from the body; only with a scan
/// Errors: kInterrupted.
Result<std::vector<std::uint8_t>> body_mask(const Volume<LabelId>& labels, const Volume<float>* scan,
                                            std::optional<double> air_below, const Progress& progress = {});

}  // namespace palpate
