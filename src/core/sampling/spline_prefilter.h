#pragma once

#include "palpate/volume/volume.h"

namespace palpate::internal {

/// Replaces values by the coefficients of the cubic B-spline that interpolates them. Along every axis (c[k-1]
/// + 4 c[k] + c[k+1]) / 6 = f[k], with c = 0 one voxel beyond either end (see SplineField).
/// @param threads  0: one per core; the result does not depend on it
void spline_prefilter(Volume<float>& values, int threads);

}  // namespace palpate::internal
