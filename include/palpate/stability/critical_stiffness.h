#pragma once

#include "palpate/stability/stability.h"

namespace palpate {

/// The highest stiffness, to 5 %, below which every touch at 0, 0.1 and 0.5 m/s is quiet in the second second
/// of the hold. Less than the critical one, at which a swing dies down ever more slowly. Errors as
/// critical_stiffness_N_per_mm.
Result<double> settling_stiffness_N_per_mm(const StabilityCase& held, const Progress& progress = {});

/// b / (T/2 + t_d), where a sampled spring gives out as much energy as the damping takes (Colgate & Schenkel
/// 1997): without friction and encoder steps the critical stiffness.
inline double theoretical_stiffness_N_per_mm(double damping_N_s_per_m, double rate_hz, double delay_s) {
  return damping_N_s_per_m / (0.5 / rate_hz + delay_s) * 1e-3;
}

}  // namespace palpate
