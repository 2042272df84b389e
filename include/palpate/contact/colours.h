#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/model.h"

/// Colours of structures and tissues. Precedence: the scene's colour of a tissue, then the structure's colour
/// from its label file, then the default grey of a tissue.
namespace palpate {

/// Replaces the colours of structures by those that the scene gives to their tissues. Other structures keep
/// theirs.
/// @param tissue_of_label  as in Model
/// @param declared         the scene's colour of each tissue; empty: none
void apply_tissue_colours(std::vector<Segment>& segments, std::span<const std::int16_t> tissue_of_label,
                          std::span<const std::optional<Rgb>> declared);

/// Colour of a structure: its segment's, after apply_tissue_colours(); for a label without a segment its
/// tissue's.
Rgb colour_of(const Model& model, LabelId label);
/// colour_of() for all labels, indexed by LabelId. Labels beyond the end have neither segment nor tissue.
std::vector<Rgb> colours_of_labels(const Model& model);
/// Colour of a tissue: that of its first structure, as seen in the image; without a structure its own.
Rgb colour_of_tissue(const Model& model, std::size_t tissue);

}  // namespace palpate
