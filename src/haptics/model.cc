#include <algorithm>

#include "palpate/haptics/haptics.h"

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

double Model::greatest_stiffness_N_per_mm() const {
  double greatest = 0;
  for (const Tissue& tissue : tissues)
    if (tissue.felt) greatest = std::max(greatest, tissue.stiffness_N_per_mm);
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
