#pragma once

#include <memory>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/model/model_preparation.h"

namespace palpate {

/// Groups of structures from which the proxy's surfaces are built, without duplicates, in the order of
/// building. Does not build surfaces; requires a model with labels and tissues. Errors: those of
/// ModelPreparation::touching_pairs; kBadInput for more surfaces than the proxy supports.
Result<std::vector<std::vector<LabelId>>> surfaces_needed(const Model& model,
                                                          const ModelPreparation& preparation,
                                                          const Progress& progress);

/// The model with the proxy's surfaces rebuilt from its labels and tissues. Requires that nothing was cut.
/// Errors: those of surfaces_needed and ModelPreparation::outer_surfaces; kInterrupted.
Result<std::shared_ptr<const Model>> with_surfaces(std::shared_ptr<const Model> model,
                                                   const ModelPreparation& preparation,
                                                   const Progress& progress);

/// Sets ContactSurface::strain_stiffening of the structures' surfaces to that of their tissues under the
/// model's law.
void set_strain_stiffening(Model& model);

}  // namespace palpate
