#pragma once

#include "palpate/verification/servo_timing.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// How the servo keeps time on this machine, beside a bare loop, and how fast it could go: notes and figures
/// of the suite `latency`.
Result<SuiteReport> run_latency(const SuiteOptions& options, const Progress& progress, const Warn& warn);

/// The same of a scene that is loaded; options.scene is ignored.
Result<SuiteReport> measure_latency(const LoadedScene& loaded, const SuiteOptions& options,
                                    const Progress& progress = {});

/// The figures of one rate.
std::vector<Figure> pace_figures(double rate_hz, const PaceFigures& pace);

/// Most that lateness of the servo may be of the bare loop's: a fifth more, or what a tick takes where that
/// is more; no scheduler is better than the one, and nobody feels the other.
/// @param bare_us     > 0
/// @param compute_us  of a tick in the same blocks
double lateness_ratio_limit(double bare_us, double compute_us);

}  // namespace palpate
