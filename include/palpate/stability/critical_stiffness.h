#pragma once

#include "palpate/stability/stability.h"

namespace palpate {

/// The highest stiffness, to 5 %, below which every touch at 0, 0.1 and 0.5 m/s is quiet in the second second
/// of the hold. Less than the critical one, at which a swing dies down ever more slowly. Errors as
/// critical_stiffness_N_per_mm.
Result<double> settling_stiffness_N_per_mm(const StabilityCase& held, const Progress& progress = {});

}  // namespace palpate
