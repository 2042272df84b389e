#pragma once

#include "palpate/stability/stability.h"

namespace palpate {

/// Highest stiffness, to 5 %, below which every impact at 0, 0.1 and 0.5 m/s has settled by the second second
/// of the hold. Lower than the critical stiffness, at which an oscillation decays ever more slowly. Errors as
/// critical_stiffness_N_per_mm.
Result<double> settling_stiffness_N_per_mm(const StabilityCase& stability_case,
                                           const Progress& progress = {});

}  // namespace palpate
