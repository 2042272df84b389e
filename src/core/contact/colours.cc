#include "palpate/contact/colours.h"

#include <algorithm>

namespace palpate {
namespace {

int tissue_at(std::span<const std::int16_t> tissue_of_label, LabelId label) {
  return label < tissue_of_label.size() ? tissue_of_label[label] : -1;
}

}  // namespace

void apply_tissue_colours(std::vector<Segment>& segments, std::span<const std::int16_t> tissue_of_label,
                          std::span<const std::optional<Rgb>> declared) {
  for (Segment& segment : segments) {
    const int tissue = tissue_at(tissue_of_label, segment.id);
    if (tissue >= 0) segment.colour = declared[static_cast<std::size_t>(tissue)].value_or(segment.colour);
  }
}

Rgb colour_of(const Model& model, LabelId label) {
  if (const Segment* segment = model.find(label)) return segment->colour;
  const Tissue* tissue = model.tissue_of(label);
  return tissue != nullptr ? tissue->colour : Rgb{};
}

std::vector<Rgb> colours_of_labels(const Model& model) {
  std::size_t labels = model.tissue_of_label.size();
  for (const Segment& segment : model.segments) labels = std::max(labels, std::size_t{segment.id} + 1);
  std::vector<Rgb> colours(labels);
  // colour_of() for each of up to 65536 labels would search the segments every time
  for (std::size_t label = 0; label < model.tissue_of_label.size(); ++label)
    if (const Tissue* tissue = model.tissue_of(static_cast<LabelId>(label))) colours[label] = tissue->colour;
  for (const Segment& segment : model.segments) colours[segment.id] = segment.colour;
  return colours;
}

Rgb colour_of_tissue(const Model& model, std::size_t tissue) {
  const auto first = std::find_if(model.segments.begin(), model.segments.end(), [&](const Segment& segment) {
    return tissue_at(model.tissue_of_label, segment.id) == static_cast<int>(tissue);
  });
  return first != model.segments.end() ? first->colour : model.tissues[tissue].colour;
}

}  // namespace palpate
