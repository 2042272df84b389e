#pragma once

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Compares measured indentation curves (SuiteOptions::curves) with the presets that they name and with the
/// tissue fitted to each. For each curve: share of its samples inside the preset's band, its end force over
/// the preset's, and modulus, stiffening and residuals of the fit. No figure has a limit. Errors: those of
/// reading the file; kUsage without one.
Result<SuiteReport> run_outside(const SuiteOptions& options, const Progress& progress, const Warn& warn);

}  // namespace palpate
