#include <algorithm>
#include <cstdio>

#include "palpate/contact/model.h"

namespace palpate {
namespace {

template <class Matches>
const Segment* find_segment(const std::vector<Segment>& segments, Matches matches) {
  const auto found = std::find_if(segments.begin(), segments.end(), matches);
  return found == segments.end() ? nullptr : &*found;
}

}  // namespace

const Segment* Model::find(const std::string& name) const {
  return find_segment(segments, [&](const Segment& s) { return s.name == name; });
}

const Segment* Model::find(LabelId id) const {
  return find_segment(segments, [&](const Segment& s) { return s.id == id; });
}

std::string Model::name_of(LabelId id) const {
  const Segment* segment = find(id);
  return segment && !segment->name.empty() ? segment->name : "label " + std::to_string(id);
}

std::string Model::enclosing_suffix(LabelId id) const {
  std::string names;
  for (const LabelId larger : enclosing_of(id)) names += (names.empty() ? "" : ", ") + name_of(larger);
  return names.empty() ? "" : " (within " + names + ")";
}

std::string burr_shape(const Tool& tool) {
  if (!tool.burr) return "";
  if (!(tool.burr->length_mm > 0)) return "ball";
  return tool.burr->end_radius_mm == tool.radius_mm ? "cylinder" : "cone";
}

std::string cutter_name(const Tool& tool) {
  return !tool.burr ? "" : tool.burr->shaver ? "shaver" : "burr";
}

std::string cutter_name(const Model& model) {
  bool burr = false, shaver = false;
  for (const Tool& tool : model.tools)
    if (tool.burr) (tool.burr->shaver ? shaver : burr) = true;
  return burr && shaver ? "burr or shaver" : burr ? "burr" : shaver ? "shaver" : "";
}

std::string burr_description(const Tool& tool) {
  if (!tool.burr) return "";
  const BurrSettings& burr = *tool.burr;
  const bool is_row = burr.length_mm > 0;
  char text[160];
  int end = std::snprintf(text, sizeof text, "%s: a %s of %g mm", cutter_name(tool).c_str(),
                          burr_shape(tool).c_str(), 2 * (is_row ? burr.end_radius_mm : tool.radius_mm));
  const auto add = [&](const char* format, double value) {
    end += std::snprintf(text + end, sizeof text - static_cast<std::size_t>(end), format, value);
  };
  if (is_row && burr.end_radius_mm != tool.radius_mm) add(", %g mm at its tip", 2 * tool.radius_mm);
  if (is_row) add(", %g mm long", burr.length_mm + tool.radius_mm + burr.end_radius_mm);
  return text;
}

double Model::max_stiffness_N_per_mm() const {
  double greatest = 0;
  for (const Tissue& tissue : tissues)
    if (tissue.touchable) greatest = std::max(greatest, tissue.stiffness_N_per_mm);
  return greatest;
}

Transform<World, Patient> supine_from_feet(const GridGeometry& grid) {
  // rows: right = +L, forward = +S, up = +A = -P
  Eigen::Matrix3d R_WorldPatient;
  R_WorldPatient << 1, 0, 0,  //
      0, 0, 1,                //
      0, -1, 0;
  return {R_WorldPatient, -(R_WorldPatient * grid.centre().eigen())};
}

}  // namespace palpate
