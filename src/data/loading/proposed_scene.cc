#include "loading/proposed_scene.h"

#include <algorithm>
#include <cstdio>

#include "palpate/loading/loading.h"

namespace palpate {
namespace {

// summary of the touchable structures of a label map: their number and presets
std::string touchable_part_of_labels(const Scene& scene, const LabelMap& labels) {
  std::size_t touchable = 0;
  std::string presets;
  for (const TissueSettings& tissue : scene.tissues) {
    if (!tissue.touchable) continue;
    touchable += tissue.labels.size();
    if (!tissue.preset.empty()) presets += (presets.empty() ? "" : ", ") + tissue.preset;
  }
  const std::size_t all = labels.segments.size();
  if (touchable == 0) return "shown only, because no label name matches a tissue";
  if (presets.empty())
    return std::to_string(touchable) + " of " + std::to_string(all) +
           " structures felt, all alike, because no label name matches a tissue";
  if (all == 1) return "felt as " + presets;
  return (touchable == all ? "all " : std::to_string(touchable) + " of ") + std::to_string(all) +
         " structures felt (" + presets + ")";
}

std::string touchable_part_of_scan(const Scene& scene) {
  const auto& threshold = scene.tissues.front().threshold;
  PALPATE_CHECK(threshold.has_value());
  char text[80];
  std::snprintf(text, sizeof text, "felt where it is brighter than %.4g",
                0.5 * ((*threshold)[0] + (*threshold)[1]));
  return text;
}

}  // namespace

Result<ProposedScene> propose_scene(const NewSceneInput& input) {
  const std::string labels = input.labels ? input.labels->string() : "",
                    scan = input.scan ? input.scan->string() : "";
  const std::string files = scan.empty() ? labels : labels.empty() ? scan : scan + " with " + labels;
  const auto text = new_scene_text(input, "");
  if (!text) {
    Error error = text.error();
    if (error.where.empty()) error.where = labels.empty() ? scan : labels;
    return error;
  }
  auto scene = parse_scene(*text, "the scene proposed for " + files);
  if (!scene) return scene.error();
  const bool both = !scan.empty() && !labels.empty();
  std::string note = files + " is a " +
                     (both             ? "scan and its label map"
                      : labels.empty() ? "scan"
                                       : "label map") +
                     ", " +
                     (input.label_map ? touchable_part_of_labels(*scene, *input.label_map)
                                      : touchable_part_of_scan(*scene)) +
                     "; to change that: palpate scene new " +
                     (both             ? scan + " " + labels
                      : labels.empty() ? "--scan " + scan
                                       : labels) +
                     (input.volume_of_scan ? " --volume " + std::to_string(*input.volume_of_scan) : "") +
                     " -o scene.toml";
  return ProposedScene{*std::move(scene), std::move(note)};
}

Result<void> require_touchable_tissue(const LoadedScene& loaded) {
  if (has_touchable_tissue(*loaded.model)) return {};
  const bool switched_off = loaded.model->max_stiffness_N_per_mm() <= 0;
  std::string remedy = loaded.proposed.empty()
                           ? switched_off
                                 ? "set touchable = true, with a preset or a stiffness, on a [[tissue]]"
                                 : "check the labels and thresholds of its tissues (palpate info shows "
                                   "what the files hold)"
                           : "name the labels after tissues (femur, liver, ...) in a table, or write a scene "
                             "file with palpate scene new and set touchable = true in it";
  return Error{ErrorKind::kBadInput,
               switched_off ? "the scene has no touchable tissue yet" : "no voxel of the scene is touchable",
               loaded.scene.source, remedy + "; palpate section and explore can show it"};
}

}  // namespace palpate
