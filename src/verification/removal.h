#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// What a burr takes out of a block of bone, prepared from labels: drilled straight in and milled along, at
/// several rates of ticks and on several grids, carved while it is felt; with limits. The same in every run.
/// Errors: kInterrupted.
Result<std::vector<Figure>> removal_figures(const Progress& progress);

/// The suite "removal".
Result<SuiteReport> run_removal(const Progress& progress);

}  // namespace palpate
