#pragma once

#include "palpate/sampling/sampling.h"

namespace palpate {

/// The founding force F = F_full f n, n = -grad f / |grad f|, written out plainly: seven trilinear
/// interpolations, one voxel after the other, in double. What a tick is held against on a machine of whatever
/// speed: it shares none of the tick's code. 0 where the gradient vanishes. N.
/// @param tip  finite
Vector<Patient> bare_force_N(const Field& field, double full_force_N, const Point<Patient>& tip);

}  // namespace palpate
