#pragma once

#include <cstdint>
#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/surfaces/ramps.h"

namespace palpate {

/// The felt structures that a volume has, with what each rests on, as prepare_ramps takes them.
std::vector<RampStructure> ramp_structures(const Model& model, const Bricks<LabelId>& labels);

/// A tissue's share of the field's full scale, of 255: its stiffness relative to the stiffest, at least one
/// step.
std::uint8_t weight_of(const Tissue& tissue, double stiffest_N_per_mm);
/// Model::level_of_label of such a tissue.
float level_of(const Tissue& tissue, std::uint8_t weight);

}  // namespace palpate
