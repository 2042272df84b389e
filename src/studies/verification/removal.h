#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Removal of bone from a block, prepared from labels, by a burr that drills and mills, at several tick rates
/// and on several grids, with carving during contact; with limits. Deterministic. Errors: kInterrupted.
Result<std::vector<Figure>> removal_figures(const Progress& progress);

/// Runs the suite "removal".
Result<SuiteReport> run_removal(const Progress& progress);

}  // namespace palpate
