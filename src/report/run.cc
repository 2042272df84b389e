#include "report/run.h"

#include <algorithm>

#include "report/html.h"

namespace palpate::report {
namespace {

const RecordingHeader::Structure* find_structure(const Recording& recording, LabelId label) {
  const auto& structures = recording.header.structures;
  const auto found = std::find_if(structures.begin(), structures.end(),
                                  [&](const RecordingHeader::Structure& s) { return s.label == label; });
  return found == structures.end() ? nullptr : &*found;
}

}  // namespace

Run::Run(const Recording& recording_in, const Model& model_in)
    : recording(recording_in),
      model(model_in),
      edges_s(tick_edges_s(recording)),
      contacts(find_contacts(recording, edges_s)),
      structures(summarise_structures(recording, model, edges_s, contacts)),
      shown(main_contacts(contacts, structures, edges_s, kMostShown)),
      summary(summary_of(recording)),
      interventions(count_ticks_with(recording, kInterventionFlags)),
      forces(force_extremes(recording)) {}

bool Run::felt_in_front() const {
  return std::any_of(structures.begin(), structures.end(),
                     [](const StructureFigures& figure) { return figure.in_front; });
}

bool Run::depth_has_gaps() const {
  return std::any_of(structures.begin(), structures.end(),
                     [](const StructureFigures& figure) { return figure.depth_has_gaps; });
}

bool Run::deeper_than_measured() const {
  return std::any_of(structures.begin(), structures.end(),
                     [](const StructureFigures& figure) { return figure.deeper_than_measured; });
}

std::string Run::name(LabelId label) const {
  const RecordingHeader::Structure* structure = find_structure(recording, label);
  if (structure != nullptr && !structure->name.empty()) return structure->name;
  return model.name_of(label);
}

Rgb Run::colour(LabelId label) const {
  if (const Segment* segment = model.find(label)) return segment->colour;
  const RecordingHeader::Structure* structure = find_structure(recording, label);
  return structure != nullptr ? structure->colour : Rgb{};
}

std::string swatch(const Rgb& colour) {
  return "<svg class=\"swatch\" viewBox=\"0 0 10 10\" aria-hidden=\"true\"><rect width=\"10\" height=\"10\" "
         "rx=\"2\" "
         "fill=\"" +
         css_colour(colour) + "\"/></svg>";
}

}  // namespace palpate::report
