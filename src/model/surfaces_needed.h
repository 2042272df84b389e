#pragma once

#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/model/preparing.h"

namespace palpate {

/// The groups of structures that the proxy's surfaces are made of, each once, in the order in which they are
/// made. Nothing is made: the model has labels and tissues. Errors: those of Preparing::touching_pairs, and
/// more surfaces than the proxy takes.
Result<std::vector<std::vector<LabelId>>> surfaces_needed(const Model& model, const Preparing& preparing,
                                                          const Progress& progress);

}  // namespace palpate
