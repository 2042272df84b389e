#pragma once

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Soft tissue against analytic cases, and how fast this machine solves it. docs/results/tissue.md.
Result<SuiteReport> run_tissue(const Progress& progress);

}  // namespace palpate
