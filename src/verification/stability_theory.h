#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Where a mass with damping, on a sampled spring that pushes and pulls, without friction or encoder steps,
/// swings no more and no less: in the simulated plant, to 0.1 %. By theory b / (T/2 + t_d).
double neutral_stiffness_N_per_mm(double damping_N_s_per_m, double rate_hz, double delay_s);

/// How far that is from theory, percent, with limits. Errors: kInterrupted.
Result<std::vector<Figure>> theory_figures(const Progress& progress);

}  // namespace palpate
