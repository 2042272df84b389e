#pragma once

#include "palpate/stability/stability.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Maximum stiffness of a wall that simulated hands and devices hold without a limit cycle, compared with
/// theory and a reference table: figures and notes of the suite `stability`. Errors: kInterrupted.
Result<SuiteReport> run_stability(const Progress& progress);

/// Figures of one case: critical and settling stiffness, the recommended and the passive fraction of it.
Result<std::vector<Figure>> stiffness_figures(const StabilityCase& stability_case, const Progress& progress);

/// Name of a case, e.g. "premium-1.5/light-grip/1kHz/delay-1ms"
std::string name_of(const StabilityCase& stability_case);

}  // namespace palpate
