#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "palpate/direct/direct_methods.h"
#include "palpation/surface_point.h"

namespace palpate {
namespace {

// depth at which ramps have the direction of the surrounding surface, and depth to which they should keep
// rising
constexpr double kInside_mm = 0.5, kPress_mm = 1.2;
// distance in front of the surface, and maximum distance from there to the structure
constexpr double kInFront_mm = 1, kEntryPath_mm = 2.5;
// fraction of full scale below which the field counts as free
constexpr double kFree = 0.02;
// radius of the patch that should be flat: about a fingertip
constexpr double kPatch_mm = 1.5;
constexpr int kRim = 8;
// scans end in the middle of bones: the cut face is not an anatomical surface
constexpr double kCutMargin_mm = 4, kNearBorder_mm = 2;

Vector<Patient> outward_normal(const Model& model, const Point<Patient>& x) {
  return -sample_central_differences(*model.field, x).gradient.normalized();
}

// the part of the grid, in voxels, where a structure's faces are anatomical and not the end of the scan:
// excludes margins at sides of the volume that the structure comes close to
struct AnatomicalRange {
  std::array<double, 3> low, high;
  bool contains(int i, int j, int k) const {
    const std::array<int, 3> index{i, j, k};
    for (int axis = 0; axis < 3; ++axis)
      if (index[axis] < low[axis] || index[axis] > high[axis]) return false;
    return true;
  }
};

AnatomicalRange anatomical_range(const Bricks<LabelId>& labels, LabelId structure) {
  const GridGeometry& grid = labels.geometry();
  std::array<int, 3> first = grid.dims, last{-1, -1, -1};
  labels.for_each_piece([&](const RowPiece<LabelId>& piece) {
    for (int n = 0; n < piece.count; ++n) {
      if (piece.voxels[n] != structure) continue;
      const std::array<int, 3> index{piece.i + n, piece.j, piece.k};
      for (int axis = 0; axis < 3; ++axis) {
        first[axis] = std::min(first[axis], index[axis]);
        last[axis] = std::max(last[axis], index[axis]);
      }
    }
  });
  AnatomicalRange part;
  for (int axis = 0; axis < 3; ++axis) {
    // scans are often padded by one or two empty slices
    const double near = kNearBorder_mm / grid.spacing_mm[axis];
    const double margin = std::min(kCutMargin_mm / grid.spacing_mm[axis], 0.25 * (last[axis] - first[axis]));
    part.low[axis] = first[axis] <= near ? first[axis] + margin : first[axis];
    part.high[axis] = last[axis] >= grid.dims[axis] - 1 - near ? last[axis] - margin : last[axis];
  }
  return part;
}

// value of the field at a structure's surface: half its level, or the value of a ramp half a voxel inside
double surface_value(const Model& model, LabelId structure) {
  const double level = model.level_of_label[structure];
  if (model.ramp_width_mm == 0) return 0.5 * level;
  return level * 0.5 * model.labels->geometry().min_spacing_mm() / model.ramp_width_mm;
}

// moves along the gradient to where the field has the given value (Newton iteration)
std::optional<Point<Patient>> onto_surface(const Model& model, Point<Patient> x, double value) {
  for (int step = 0; step < 12; ++step) {
    const FieldSample sample = sample_central_differences(*model.field, x);
    const double slope = sample.gradient.norm();
    if (slope < 1e-3) return std::nullopt;
    const double distance_mm = std::clamp((sample.value - value) / slope, -0.5, 0.5);
    x += sample.gradient.normalized() * -distance_mm;
    if (std::abs(distance_mm) < 1e-3) return x;
  }
  return std::nullopt;
}

// free distance along the normal: down the ramp into free space, until the field rises again
double clearance_along(const Model& model, const Point<Patient>& surface, const Vector<Patient>& n,
                       double max_mm) {
  constexpr double kStep_mm = 0.25;
  double previous = sample_value(*model.field, surface);
  for (double distance = kStep_mm; distance <= max_mm; distance += kStep_mm) {
    const double here = sample_value(*model.field, surface + n * distance);
    if (here > previous + 1e-3 && here > kFree) return distance - kStep_mm;
    previous = here;
  }
  return max_mm;
}

// maximum outward curvature of the surrounding patch, 1/mm: a tool slips off strongly curved surfaces
double convexity(const Model& model, const Point<Patient>& surface, const Vector<Patient>& n) {
  // ramps have no gradient outside
  const bool ramps = model.ramp_width_mm > 0;
  const Point<Patient> centre = ramps ? surface - n * kInside_mm : surface;
  double largest = 0;
  for (const Vector<Patient>& t : directions_around<kRim>(n)) {
    const Vector<Patient> normal = outward_normal(model, centre + t * kPatch_mm);
    // a rim point in free space indicates strong curvature
    const double tilt = ramps && normal == Vector<Patient>() ? 1 : normal.dot(t);
    largest = std::max(largest, tilt / kPatch_mm);
  }
  return largest;
}

// first label with contact along the inward direction
LabelId first_touchable(const Model& model, const Point<Patient>& from, const Vector<Patient>& inward) {
  const Bricks<LabelId>& labels = *model.labels;
  const double step_mm = 0.5 * labels.geometry().min_spacing_mm();
  for (double distance_mm = 0; distance_mm <= kEntryPath_mm; distance_mm += step_mm) {
    const Point<Voxel> p = model.labels->X_VoxelPatient() * (from + inward * distance_mm);
    const auto index = [&](int axis) { return static_cast<int>(std::floor(p[axis] + 0.5)); };
    const LabelId label = labels.anywhere(index(0), index(1), index(2));
    if (model.is_touchable(label)) return label;
  }
  return 0;
}

// ratio of a ramp's actual to its nominal force at pressing depth: lower in thin tissue, and where the normal
// changes with depth
double ramp_force_ratio(const Model& model, const SurfacePoint& candidate, LabelId structure) {
  if (model.ramp_width_mm == 0) return 1;
  const FieldSample below =
      sample_central_differences(*model.field, candidate.point - candidate.normal * kPress_mm);
  const double promised = model.level_of_label[structure] * std::min(1.0, kPress_mm / model.ramp_width_mm);
  const double agreement = std::max(0.0, -below.gradient.normalized().dot(candidate.normal));
  return std::min(1.0, below.value / promised) * agreement;
}

// share of the patch (centre and rim) whose inward ray meets the structure itself first
double own_fraction(const Model& model, const Point<Patient>& surface, const Vector<Patient>& n,
                    LabelId structure) {
  const auto is_own = [&](const Vector<Patient>& along_surface) {
    // ramps exist inside only: use the labels
    if (model.ramp_width_mm > 0)
      return first_touchable(model, surface + along_surface + n * kInFront_mm, -n) == structure ? 1 : 0;
    const Point<Patient> x = surface + along_surface + n * (0.5 * model.sigma_mm);
    const FieldSample sample = sample_central_differences(*model.field, x);
    return find_contact_site(model, x, sample).label == structure ? 1 : 0;
  };
  int own = is_own({});
  for (const Vector<Patient>& t : directions_around<kRim>(n)) own += is_own(t * kPatch_mm);
  return own / (kRim + 1.0);
}

}  // namespace

std::vector<Point<Patient>> border_voxels(const Model& model, LabelId structure) {
  const Bricks<LabelId>& labels = *model.labels;
  const auto X_PatientVoxel = labels.geometry().X_PatientVoxel();
  const auto& faces = BrickLayout::kFaces;
  const AnatomicalRange uncut = anatomical_range(labels, structure);
  std::vector<Point<Patient>> border;
  labels.for_each_piece([&](const RowPiece<LabelId>& piece) {
    if (piece.uniform && model.is_touchable(*piece.voxels)) return;
    for (int n = 0; n < piece.count; ++n) {
      const LabelId* const voxel = piece.voxels + n;
      if (*voxel != structure || !uncut.contains(piece.i + n, piece.j, piece.k)) continue;
      if (std::any_of(faces.begin(), faces.end(),
                      [&](auto face) { return !model.is_touchable(voxel[face]); }))
        border.push_back(X_PatientVoxel * Point<Voxel>(piece.i + n, piece.j, piece.k));
    }
  });
  return border;
}

std::vector<SurfaceCandidate> surface_candidates(const Model& model, LabelId structure,
                                                 std::span<const Point<Patient>> border,
                                                 double clearance_mm) {
  constexpr std::size_t kMaxCandidates = 4000;
  const std::size_t stride = border.size() / kMaxCandidates + 1;
  const double value = surface_value(model, structure);
  std::vector<SurfaceCandidate> candidates;
  for (std::size_t c = 0; c < border.size(); c += stride) {
    const auto surface = onto_surface(model, border[c], value);
    if (!surface) continue;
    SurfacePoint candidate;
    candidate.point = *surface;
    candidate.normal = outward_normal(model, *surface);
    if (model.ramp_width_mm > 0) {
      const Vector<Patient> below = outward_normal(model, *surface - candidate.normal * kInside_mm);
      // in a thin structure the gradient may belong to the opposite side
      if (below.dot(candidate.normal) > 0) candidate.normal = below;
    }
    candidate.clearance_mm = clearance_along(model, *surface, candidate.normal, clearance_mm);

    // reach, flatness and ownership, each between 0 and 1; ownership has the largest weight
    const double reach = candidate.clearance_mm / clearance_mm;
    const double evenness = 1 / (1 + 8 * convexity(model, *surface, candidate.normal));
    const double own = own_fraction(model, *surface, candidate.normal, structure);
    // a thin wall gives a ramp no force, but still stops the proxy
    const double firmness = 0.02 + 0.98 * ramp_force_ratio(model, candidate, structure);
    const double score = own * own * own * evenness * (0.15 + reach) * firmness;
    if (score > 0) candidates.push_back({candidate, score});
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  return candidates;
}

Result<SurfacePoint> find_surface_point(const Model& model, LabelId structure, double clearance_mm) {
  const std::string name = "'" + model.name_of(structure) + "'";
  if (!model.is_touchable(structure))
    return Error{ErrorKind::kBadInput, name + " is not touchable in this scene", "",
                 "set touchable = true on its [[tissue]], or choose another structure"};
  if (model.field == nullptr)
    return Error{ErrorKind::kBadInput, "the model has no field to find a surface of " + name + " in", "model",
                 "prepare it for a direct method as well"};
  const auto candidates = surface_candidates(model, structure, border_voxels(model, structure), clearance_mm);
  if (candidates.empty())
    return Error{ErrorKind::kBadInput,
                 "no surface of " + name + " can be touched: it is covered, or too thin after smoothing", "",
                 model.ramp_width_mm > 0 ? "choose another structure"
                                         : "lower sigma in [preparation], or choose another structure"};
  return candidates.front().surface;
}

}  // namespace palpate
