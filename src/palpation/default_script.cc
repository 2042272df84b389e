#include <algorithm>
#include <cstdio>

#include "palpate/palpation/palpation.h"

namespace palpate {
namespace {

// minimum force of a press step
constexpr double kMinPress_N = 0.05;

bool has_every_structure(const Model& model, const Script& script) {
  return std::all_of(script.steps.begin(), script.steps.end(), [&](const ScriptStep& step) {
    const auto* approach = std::get_if<ApproachStep>(&step);
    if (!approach) return true;
    const Segment* segment = model.find(approach->structure);
    return segment != nullptr && model.is_felt(segment->id);
  });
}

// structures with contact, by descending number of voxels
std::vector<LabelId> largest_felt(const Model& model, std::size_t most) {
  const std::vector<std::size_t> voxels = label_counts(*model.labels);
  std::vector<LabelId> labels;
  for (const Segment& segment : model.segments)
    if (model.is_felt(segment.id) && voxels[segment.id] > 0) labels.push_back(segment.id);
  std::stable_sort(labels.begin(), labels.end(), [&](LabelId a, LabelId b) { return voxels[a] > voxels[b]; });
  if (labels.size() > most) labels.resize(most);
  return labels;
}

// maximum force that every structure can render, by label: less for soft tissue, and for thin ramps
std::vector<double> max_forces_N(const Model& model) {
  std::vector<double> most(model.level_of_label.begin(), model.level_of_label.end());
  if (model.ramp_width_mm > 0) {
    std::fill(most.begin(), most.end(), 0.0);
    const Volume<float> values = model.field->values();
    model.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
      const float* const value = &values.at(piece.i, piece.j, piece.k);
      for (int n = 0; n < piece.count; ++n)
        if (const LabelId label = piece.voxels[n]; label < most.size())
          most[label] = std::max(most[label], static_cast<double>(value[n]));
    });
  }
  const double full_N = model.force_field(ForceMethod::kTrilinear).full_force_N();
  for (double& value : most) value *= full_N;
  return most;
}

}  // namespace

std::string default_script_text(const Model& model) {
  const auto knee_text = embedded_script("knee");
  PALPATE_CHECK(knee_text.has_value());
  const auto knee = parse_script(*knee_text, "embedded knee script");
  PALPATE_CHECK(knee.ok());
  if (has_every_structure(model, *knee)) return std::string(*knee_text);

  std::string text = "# the largest felt structures of this scene, each pressed with 1 N and held\n";
  text += "title = \"largest structures\"\n";
  const std::vector<double> max_N = max_forces_N(model);
  for (const LabelId label : largest_felt(model, 6)) {
    // structures that cannot be reached are omitted; soft ones are pressed with what they can render
    if (!find_surface_point(model, label, ApproachStep{}.clearance_mm)) continue;
    char press[32];
    std::snprintf(press, sizeof press, "%.3f", std::max(kMinPress_N, std::min(1.0, 0.6 * max_N[label])));
    text += "\n[[step]]\napproach = \"#" + std::to_string(label) + "\"\n[[step]]\npress = " + press + "\n";
    text += "[[step]]\nhold = 0.7\n[[step]]\nleave = true\n";
  }
  return text;
}

}  // namespace palpate
