#pragma once

#include "palpate/volume/volume.h"

namespace palpate::internal {

/// Turns values into the coefficients of the cubic B-spline that interpolates them, in place. Along every
/// axis (c[k-1] + 4 c[k] + c[k+1]) / 6 = f[k], with 0 one voxel beyond either end (SplineField says why).
/// threads: 0 for as many as there are cores. The result does not depend on it.
void spline_prefilter(Volume<float>& values, int threads);

}  // namespace palpate::internal
