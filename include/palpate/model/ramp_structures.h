#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/surfaces/ramps.h"

namespace palpate {

/// Touchable structures that occur in a volume, with the structures that support each, as input of
/// prepare_ramps.
std::vector<RampStructure> ramp_structures(const Model& model, const Bricks<LabelId>& labels);

/// A tissue's fraction of the field's full scale, of 255: its stiffness relative to the stiffest, at least 1.
std::uint8_t weight_of(const Tissue& tissue, double stiffest_N_per_mm);
/// Model::level_of_label for a tissue of that weight.
float level_of(const Tissue& tissue, std::uint8_t weight);

}  // namespace palpate
