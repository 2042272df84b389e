#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "palpate/contact/contact_settings.h"
#include "palpate/direct/direct_methods.h"

namespace palpate {
namespace {

// unit vectors along the patient's axes and space diagonals
constexpr double kD = 0.57735026918962576;
constexpr double kDirections[14][3] = {{1, 0, 0},      {-1, 0, 0},     {0, 1, 0},     {0, -1, 0},
                                       {0, 0, 1},      {0, 0, -1},     {kD, kD, kD},  {kD, kD, -kD},
                                       {kD, -kD, kD},  {kD, -kD, -kD}, {-kD, kD, kD}, {-kD, kD, -kD},
                                       {-kD, -kD, kD}, {-kD, -kD, -kD}};

// touchable label of the voxel at a point; 0 if there is none
LabelId touchable_label_at(const Model& model, const Point<Voxel>& p) {
  const Bricks<LabelId>& labels = *model.labels;
  const auto& dims = labels.geometry().dims;
  int index[3];
  for (int axis = 0; axis < 3; ++axis) {
    if (!(p[axis] > -0.5 && p[axis] < dims[axis] - 0.5)) return 0;
    index[axis] = std::min(static_cast<int>(p[axis] + 0.5), dims[axis] - 1);
  }
  const LabelId label = labels.at(index[0], index[1], index[2]);
  return model.is_touchable(label) ? label : LabelId{0};
}

// ray marching through the labels in steps of half a voxel
class LabelRay {
 public:
  LabelRay(const Model& model, const Point<Patient>& x)
      : model_(model),
        start_(model.labels->X_VoxelPatient() * x),
        step_mm_(0.5 * model.labels->geometry().min_spacing_mm()),
        steps_(static_cast<int>(model.reach_mm / step_mm_)) {}

  LabelId here() const { return touchable_label_at(model_, start_); }
  double step_mm() const { return step_mm_; }

  // first touchable label along a unit direction, including that at x itself
  LabelId first_along(const Vector<Patient>& direction) const {
    const Vector<Voxel> step = model_.labels->X_VoxelPatient() * (direction * step_mm_);
    Point<Voxel> p = start_;
    for (int n = 0; n <= steps_; ++n, p += step)
      if (const LabelId label = touchable_label_at(model_, p)) return label;
    return 0;
  }

  // nearest touchable label along the patient's axes and diagonals
  LabelId nearest() const {
    std::array<Vector<Voxel>, 14> step;
    for (std::size_t d = 0; d < step.size(); ++d) {
      const auto& u = kDirections[d];
      step[d] = model_.labels->X_VoxelPatient() * (Vector<Patient>(u[0], u[1], u[2]) * (2 * step_mm_));
    }
    for (int n = 0; n <= steps_ / 2; ++n)
      for (const Vector<Voxel>& s : step)
        if (const LabelId label = touchable_label_at(model_, start_ + s * n)) return label;
    return 0;
  }

  // signed distance along a direction to the boundary of the voxels of `own`: positive inside them, negative
  // outside
  double depth_in(LabelId own, const Vector<Patient>& outward) const {
    const bool inside = here() == own;
    const Vector<Voxel> per_mm = model_.labels->X_VoxelPatient() * (inside ? outward : -outward);
    const auto is_farther_than = [&](double distance_mm) {
      return (touchable_label_at(model_, start_ + per_mm * distance_mm) == own) != inside;
    };
    for (int n = 1; n <= steps_; ++n) {
      if (!is_farther_than(n * step_mm_)) continue;
      double near = (n - 1) * step_mm_, far = n * step_mm_;
      for (int halving = 0; halving < 6; ++halving) {
        const double midpoint = 0.5 * (near + far);
        (is_farther_than(midpoint) ? far : near) = midpoint;
      }
      return inside ? far : -far;
    }
    return std::numeric_limits<double>::quiet_NaN();
  }

  // touchable label that covers `own` in the outward direction; 0 for free space or none within reach
  LabelId cover_of(LabelId own, const Vector<Patient>& outward) const {
    const Vector<Voxel> step = model_.labels->X_VoxelPatient() * (outward * step_mm_);
    Point<Voxel> p = start_;
    for (int n = 0; n <= steps_; ++n, p += step)
      if (const LabelId label = touchable_label_at(model_, p); label != own) return label;
    return 0;
  }

 private:
  const Model& model_;
  Point<Voxel> start_;
  double step_mm_;
  int steps_;
};

// signed distance along a direction to the isosurface of `level`, positive inside; the value at x determines
// the search direction, the crossing is interpolated linearly within a step
double depth_of_level(const Model& model, const Point<Patient>& x, const Vector<Patient>& outward,
                      double level, double step_mm) {
  const double value = sample_value(*model.field, x);
  const bool inside = value >= level;
  const Vector<Patient> direction = inside ? outward : -outward;
  double previous = value;
  for (double distance = step_mm; distance <= model.reach_mm; distance += step_mm) {
    const double here = sample_value(*model.field, x + direction * distance);
    if ((here >= level) != inside) {
      const double part = (level - previous) / (here - previous);
      const double crossing = distance - step_mm + part * step_mm;
      return inside ? crossing : -crossing;
    }
    previous = here;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

ContactSite find_contact_site(const Model& model, const Point<Patient>& x, const FieldSample& sample) {
  if (sample.value == 0) return {};
  const LabelRay ray(model, x);
  const Vector<Patient> outward = -sample.gradient.normalized();
  const bool has_direction = outward != Vector<Patient>();

  ContactSite site;
  site.label = has_direction ? ray.first_along(-outward) : ray.here();
  if (site.label == 0) site.label = ray.nearest();
  if (site.label == 0) {
    site.depth_mm = std::numeric_limits<double>::quiet_NaN();
    return site;
  }
  site.tissue = model.tissue_of_label[site.label];
  site.level = model.level_of_label[site.label];

  // ramps begin at the boundary of the structure's own voxels
  if (model.ramp_width_mm > 0) {
    site.level *= std::min(1.0, kContactSettings.full_viscosity_mm / model.ramp_width_mm);
    site.depth_mm =
        has_direction ? ray.depth_in(site.label, outward) : std::numeric_limits<double>::quiet_NaN();
    return site;
  }

  // the surface of a smoothed label is midway between its level and that of its cover
  const LabelId cover =
      has_direction && ray.here() == site.label ? ray.cover_of(site.label, outward) : LabelId{0};
  const double cover_level = cover ? model.level_of_label[cover] : 0;
  site.depth_mm = has_direction
                      ? depth_of_level(model, x, outward, 0.5 * (cover_level + site.level), ray.step_mm())
                      : std::numeric_limits<double>::quiet_NaN();
  return site;
}

}  // namespace palpate
