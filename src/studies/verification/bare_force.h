#pragma once

#include "palpate/sampling/sampling.h"

namespace palpate {

/// The founding force F = F_full f n, n = -grad f / |grad f|, implemented plainly: seven scalar trilinear
/// interpolations in double. Reference for the cost of a tick on a machine of any speed; it shares no code
/// with the tick. 0 where the gradient vanishes. N.
/// @param tip  finite
Vector<Patient> bare_force_N(const Field& field, double full_force_N, const Point<Patient>& tip);

}  // namespace palpate
