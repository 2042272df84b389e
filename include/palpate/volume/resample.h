#pragma once

#include "palpate/base/result.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

namespace palpate {

/// Resamples a scan onto `grid` by trilinear interpolation; `outside` beyond the scan. Errors: kBadInput if
/// the two do not overlap.
Result<Volume<float>> resample_linear(const Volume<float>& scan, const GridGeometry& grid, float outside);

/// Resamples labels onto `grid` by nearest neighbour; 0 beyond the labels. Errors: kBadInput if the two do
/// not overlap.
Result<LabelMap> resample_nearest(const LabelMap& labels, const GridGeometry& grid);

}  // namespace palpate
