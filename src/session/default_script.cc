#include <algorithm>
#include <cstdio>

#include "palpate/session.h"

namespace palpate {
namespace {

// the least that a script may ask for
constexpr double kLeastPress_N = 0.05;

bool has_every_structure(const Model& model, const Script& script) {
  return std::all_of(script.steps.begin(), script.steps.end(), [&](const ScriptStep& step) {
    const auto* approach = std::get_if<ApproachStep>(&step);
    if (!approach) return true;
    const Segment* segment = model.find(approach->structure);
    return segment != nullptr && model.is_felt(segment->id);
  });
}

// the felt structures with most voxels, largest first
std::vector<LabelId> largest_felt(const Model& model, std::size_t most) {
  std::vector<std::size_t> voxels(65536, 0);
  for (const LabelId label : model.labels->voxels()) ++voxels[label];
  std::vector<LabelId> labels;
  for (const Segment& segment : model.segments)
    if (model.is_felt(segment.id) && voxels[segment.id] > 0) labels.push_back(segment.id);
  std::stable_sort(labels.begin(), labels.end(), [&](LabelId a, LabelId b) { return voxels[a] > voxels[b]; });
  if (labels.size() > most) labels.resize(most);
  return labels;
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
  for (const LabelId label : largest_felt(model, 6)) {
    // what cannot be touched is left out; what is soft is pressed as much as it can give
    if (!find_surface_point(model, label, ApproachStep{}.clearance_mm)) continue;
    const double most_N =
        model.force_field(ForceMethod::kTrilinear).full_force_N() * model.level_of_label[label];
    char press[32];
    std::snprintf(press, sizeof press, "%.3f", std::max(kLeastPress_N, std::min(1.0, 0.6 * most_N)));
    text += "\n[[step]]\napproach = \"#" + std::to_string(label) + "\"\n[[step]]\npress = " + press + "\n";
    text += "[[step]]\nhold = 0.7\n[[step]]\nleave = true\n";
  }
  return text;
}

}  // namespace palpate
