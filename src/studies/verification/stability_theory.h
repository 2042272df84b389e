#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Stiffness of a sampled bilateral spring at which the oscillation of a damped mass neither grows nor
/// decays, without friction and encoder quantisation, in the simulated plant, to 0.1 %. The theoretical value
/// is b / (T/2 + t_d).
double neutral_stiffness_N_per_mm(double damping_N_s_per_m, double rate_hz, double delay_s);

/// Deviation from theory, percent, with limits. Errors: kInterrupted.
Result<std::vector<Figure>> theory_figures(const Progress& progress);

}  // namespace palpate
