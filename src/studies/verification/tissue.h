#pragma once

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Soft tissue compared with analytic solutions, and the speed of its solver on this machine.
/// docs/results/tissue.md.
Result<SuiteReport> run_tissue(const Progress& progress);

}  // namespace palpate
