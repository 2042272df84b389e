#pragma once

#include <memory>
#include <span>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/model/preparing.h"

namespace palpate {

/// The groups of structures that the proxy's surfaces are made of, each once, in the order in which they are
/// made. Nothing is made: the model has labels and tissues. Errors: those of Preparing::touching_pairs, and
/// more surfaces than the proxy takes.
Result<std::vector<std::vector<LabelId>>> surfaces_needed(const Model& model, const Preparing& preparing,
                                                          const Progress& progress);

/// The model with the surfaces that the proxy leans on, made anew from its labels and tissues in place of
/// what it has. Nothing was cut. Errors: those of surfaces_needed and Preparing::outer_surfaces;
/// kInterrupted.
Result<std::shared_ptr<const Model>> with_surfaces(std::shared_ptr<const Model> model,
                                                   const Preparing& preparing, const Progress& progress);

/// The times with which tissues relax that yield by that law. Errors: kBadInput for a series that no tissue
/// has, and for more times than there is room for.
Result<RelaxationTimes> relaxation_times_of(std::span<const Tissue> tissues, TissueLaw law);

}  // namespace palpate
