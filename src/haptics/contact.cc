#include <cmath>

#include "palpate/haptics.h"

namespace palpate {
namespace {

// the label of the nearest voxel, 0 outside the volume
LabelId label_at(const Volume<LabelId>& labels, const Point<Voxel>& p) {
  const auto& dims = labels.geometry().dims;
  int index[3];
  for (int axis = 0; axis < 3; ++axis) {
    if (!(p[axis] > -0.5 && p[axis] < dims[axis] - 0.5)) return 0;
    index[axis] = static_cast<int>(p[axis] + 0.5);
  }
  return labels.at(index[0], index[1], index[2]);
}

// the signed way from x to where the field crosses `level`, positive when x is beyond it; x's own
// value tells which way to look, and the crossing is interpolated linearly within a step
double depth_of_level(const Field& field, const Point<Patient>& x, const Vector<Patient>& outward,
                      double value, double level, double step_mm, double reach_mm) {
  const bool inside = value >= level;
  const Vector<Patient> step = outward * (inside ? step_mm : -step_mm);
  double previous = value;
  for (double way = step_mm; way <= reach_mm; way += step_mm) {
    const double here = sample_value(field, x + step * (way / step_mm));
    if ((here >= level) != inside) {
      const double part = (level - previous) / (here - previous);
      const double crossing = way - step_mm + part * step_mm;
      return inside ? crossing : -crossing;
    }
    previous = here;
  }
  return inside ? reach_mm : -reach_mm;
}

}  // namespace

ContactSite find_contact_site(const Model& model, const Point<Patient>& x, const FieldSample& sample,
                              double reach_mm) {
  if (sample.value == 0) return {};
  const Transform<Voxel, Patient>& X_VoxelPatient = model.field->X_VoxelPatient();
  const double step_mm = 0.5 * model.labels->geometry().min_spacing_mm();
  const Vector<Patient> outward = -sample.gradient.normalized();

  // the first felt label on the way inward; deep inside, where the gradient vanishes, there is no
  // way and only the tip's own label counts
  const bool has_direction = outward != Vector<Patient>();
  const Vector<Voxel> inward_step = X_VoxelPatient * (outward * -step_mm);
  Point<Voxel> p = X_VoxelPatient * x;
  ContactSite site;
  for (double way = 0; way <= (has_direction ? reach_mm : 0); way += step_mm, p += inward_step) {
    const LabelId label = label_at(*model.labels, p);
    if (model.is_felt(label)) {
      site.label = label;
      break;
    }
  }
  if (site.label == 0) return {};

  site.tissue = model.tissue_of_label[site.label];
  site.level = model.level_of_label[site.label];
  site.depth_mm = has_direction ? depth_of_level(*model.field, x, outward, sample.value, 0.5 * site.level,
                                                 step_mm, reach_mm)
                                : reach_mm;
  return site;
}

}  // namespace palpate
