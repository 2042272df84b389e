#pragma once

#include "palpate/verification/servo_timing.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Timing of the servo on this machine relative to a bare loop, and its free-running speed: notes and figures
/// of the suite `latency`.
Result<SuiteReport> run_latency(const SuiteOptions& options, const Progress& progress, const Warn& warn);

/// Same for a loaded scene; options.scene is ignored.
Result<SuiteReport> measure_latency(const LoadedScene& loaded, const SuiteOptions& options,
                                    const Progress& progress = {});

/// The figures of one rate.
std::vector<Figure> pace_figures(double rate_hz, const PaceFigures& pace);

/// Limit of the ratio of the servo's lateness to the bare loop's: 1.2, or the ratio that results from the
/// duration of a tick if that is greater. Schedulers do not reproduce lateness any better than the former,
/// and the latter is imperceptible.
/// @param bare_us     > 0
/// @param compute_us  duration of a tick in the same blocks
double lateness_ratio_limit(double bare_us, double compute_us);

}  // namespace palpate
