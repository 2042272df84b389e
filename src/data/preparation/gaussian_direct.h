#pragma once

#include "palpate/preparation/preparation.h"
#include "palpate/volume/slices.h"

namespace palpate::internal {

/// Direct separable convolution; sigma has been validated. In, Out: bytes to bytes, 16 bits (times 257) or
/// floats; floats to floats.
template <class In, class Out>
Result<Volume<Out>> smooth_direct(const Volume<In>& volume, const std::array<double, 3>& sigma_voxels,
                                  int threads, const Progress& progress, const ProgressSpan& span);

}  // namespace palpate::internal
