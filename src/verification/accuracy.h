#pragma once

#include <vector>

#include "palpate/verification/verification.h"

namespace palpate {

/// How far every method's force is from the truth: direction and magnitude at random points near known
/// surfaces, and how it changes along them, from prepared binary volumes and from exactly sampled ones.
/// Errors: kInterrupted; kBadInput where there is not enough memory.
Result<std::vector<Figure>> run_accuracy(const Progress& progress);

/// Most that a figure of the suite may be; nothing for figures without a limit.
std::optional<double> accuracy_limit(const std::string& figure);

}  // namespace palpate
