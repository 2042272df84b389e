#pragma once

#include <vector>

#include "palpate/verification/verification.h"

namespace palpate {

/// Errors of every method's force relative to the exact one: direction and magnitude at random points near
/// analytic surfaces, and changes along these, for prepared binary volumes and for exactly sampled ones.
/// Errors: kInterrupted; kBadInput for insufficient memory.
Result<std::vector<Figure>> run_accuracy(const Progress& progress);

/// Limit of a figure of the suite; empty: no limit.
std::optional<double> accuracy_limit(const std::string& figure);

}  // namespace palpate
