#pragma once

#include "palpate/stability/stability.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// How stiff a wall the simulated hands and devices hold without a limit cycle, beside theory and the table
/// of reference: the figures and notes of the suite `stability`. Errors: kInterrupted.
Result<SuiteReport> run_stability(const Progress& progress);

/// The figures of one case: critical and settling stiffness, what is recommended of it and what is passive.
Result<std::vector<Figure>> stiffness_figures(const StabilityCase& held, const Progress& progress);

/// "premium-1.5/light-grip/1kHz/delay-1ms"
std::string name_of(const StabilityCase& held);

}  // namespace palpate
