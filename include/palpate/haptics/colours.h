#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "palpate/haptics/haptics.h"

/// What structures and tissues are drawn in. What the scene says of a tissue counts before what a structure
/// has from its label file, and that before the grey of a tissue of which the scene says nothing.
namespace palpate {

/// Gives the structures the colours that the scene says of their tissues; the others keep their own.
/// @param tissue_of_label  as in Model
/// @param said             of each tissue; empty: the scene says none
void take_colours_of_tissues(std::vector<Segment>& segments, std::span<const std::int16_t> tissue_of_label,
                             std::span<const std::optional<Rgb>> said);

/// Of a structure: the segment's, which take_colours_of_tissues has settled; a label without a segment has
/// its tissue's.
Rgb colour_of(const Model& model, LabelId label);
/// The same of every label, by LabelId; those after the last have neither segment nor tissue.
std::vector<Rgb> colours_of_labels(const Model& model);
/// Of a tissue: its first structure's, by which it is known in a picture; without one its own.
Rgb colour_of_tissue(const Model& model, std::size_t tissue);

}  // namespace palpate
