#include "palpate/palpation/touch_site.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include "palpation/surface_point.h"

namespace palpate {
namespace {

constexpr std::size_t kMaxPoints = 8;
// minimum distance between two places to be tried
constexpr double kSeparation_mm = 4, kRequestedSeparation_mm = 2;
// a requested place may be missed by this much in favour of one that suits a press better
constexpr double kSuitabilityBonus_mm = 2;
// tilt of an approach against the normal, and minimum cosine for a requested direction
constexpr double kTilt = 35 * std::numbers::pi / 180, kMinFacing = 0.3;
// if no straight segment of the requested length exists, it may be longer by this much
constexpr double kLonger_mm = 10;
constexpr int kTouchRim = 8;

LabelId touchable_label_at(const Model& model, const Point<Patient>& x) {
  const Point<Voxel> p = model.labels->X_VoxelPatient() * x;
  const auto index = [&](int axis) { return static_cast<int>(std::floor(p[axis] + 0.5)); };
  const LabelId label = model.labels->anywhere(index(0), index(1), index(2));
  return model.is_touchable(label) ? label : LabelId{0};
}

/// Straight final segment of an approach.
class FinalSegment {
 public:
  FinalSegment(const Model& model, const FreeSpace& free_space, LabelId structure, double clearance_mm)
      : model_(model),
        free_space_(free_space),
        structure_(structure),
        clearance_mm_(clearance_mm),
        reach_mm_(tool_reach_mm(model.tool_of(0))) {}

  // Longest free segment up to the requested length whose beginning is reachable, otherwise the shortest
  // longer one.
  std::optional<TouchSite> along(const SurfacePoint& surface, const Vector<Patient>& from) const {
    const double step_mm = 0.5 * model_.labels->geometry().min_spacing_mm();
    const double front_mm = model_.sigma_mm + reach_mm_;
    const auto rim = directions_around<kTouchRim>(from);
    std::optional<double> before_mm;
    for (double distance = step_mm; distance <= clearance_mm_ + kLonger_mm + reach_mm_; distance += step_mm) {
      if (before_mm && distance > clearance_mm_) break;
      const Point<Patient> here = surface.point + from * distance;
      if (!is_free(here, rim, distance > front_mm)) break;
      if (distance >= front_mm && free_space_.reachable(here)) before_mm = distance;
    }
    if (!before_mm) return std::nullopt;
    return TouchSite{surface, from, surface.point + from * *before_mm, surface.point + from * front_mm};
  }

 private:
  // free of everything but the structure itself, which is near at the end of the path
  bool is_free(const Point<Patient>& here, const std::array<Vector<Patient>, kTouchRim>& rim,
               bool clear_of_structure) const {
    const auto fits = [&](const Point<Patient>& x) {
      const LabelId label = touchable_label_at(model_, x);
      return label == 0 || (label == structure_ && !clear_of_structure);
    };
    return fits(here) && (reach_mm_ == 0 || std::all_of(rim.begin(), rim.end(), [&](const auto& direction) {
                            return fits(here + direction * reach_mm_);
                          }));
  }

  const Model& model_;
  const FreeSpace& free_space_;
  LabelId structure_;
  double clearance_mm_, reach_mm_;
};

// distance from the requested place, mm, up to a constant
double deviation_mm(const TouchRequest& request, const Point<Patient>& p) {
  if (request.landmark) return -request.landmark->dot(p - Point<Patient>());
  double smallest = std::numeric_limits<double>::infinity();
  for (const Point<Patient>& q : request.near) smallest = std::min(smallest, (p - q).squared_norm());
  return std::sqrt(smallest);
}

// neighbours of a structure that borders no free space
std::string cover_of(const Model& model, LabelId structure) {
  std::vector<std::size_t> faces(65536, 0);
  std::size_t own = 0;
  model.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
    for (int n = 0; n < piece.count; ++n) {
      const LabelId* const voxel = piece.voxels + n;
      if (*voxel != structure) continue;
      ++own;
      for (const std::ptrdiff_t face : BrickLayout::kFaces)
        if (voxel[face] != structure && model.is_touchable(voxel[face])) ++faces[voxel[face]];
    }
  });
  if (own == 0) return "it has no voxel";
  const auto most = std::max_element(faces.begin(), faces.end());
  if (*most == 0) return "the scan cuts it off on all sides";
  return "it is covered by " + model.name_of(static_cast<LabelId>(most - faces.begin()));
}

// no-go region that repels the outline of the tool at a place; null: none
const NoGoRegion* no_go_at(const Model& model, const Point<Patient>& tip) {
  if (model.no_go.empty()) return nullptr;
  const ToolPart outline{{}, tool_reach_mm(model.tool_of(0))};
  const NoGoForce push = no_go_force(model.no_go, model.distance_trees, {&outline, 1}, tip);
  return push.region < 0 ? nullptr : &model.no_go[static_cast<std::size_t>(push.region)];
}

// touchable structure that is most often in front of the surface of a structure; 0: none
LabelId in_front_of(const Model& model, LabelId structure, std::span<const SurfaceCandidate> candidates) {
  constexpr std::size_t kMaxSampled = 200;
  constexpr double kMaxDistance_mm = 200;
  const double step_mm = model.labels->geometry().min_spacing_mm();
  std::map<LabelId, std::size_t> counts;
  const std::size_t stride = candidates.size() / kMaxSampled + 1;
  for (std::size_t c = 0; c < candidates.size(); c += stride) {
    const SurfacePoint& surface = candidates[c].surface;
    for (double distance_mm = step_mm; distance_mm <= kMaxDistance_mm; distance_mm += step_mm) {
      const LabelId label = touchable_label_at(model, surface.point + surface.normal * distance_mm);
      if (label == 0 || label == structure) continue;
      ++counts[label];
      break;
    }
  }
  const auto most = std::ranges::max_element(counts, {}, [](const auto& count) { return count.second; });
  return most == counts.end() ? LabelId{0} : most->first;
}

}  // namespace

double tool_reach_mm(const Tool& tool) {
  double reach_mm = 0;
  for (const Eigen::Vector3d& offset_mm : tool.points_mm)
    reach_mm = std::max(reach_mm, offset_mm.norm() + tool.radius_mm);
  for (const ToolCapsule& capsule : tool.capsules)
    reach_mm = std::max(reach_mm, std::max(capsule.from_mm.norm(), capsule.to_mm.norm()) + capsule.radius_mm);
  return reach_mm;
}

TouchSites find_touch_sites(const Model& model, const FreeSpace& free_space, LabelId structure,
                            const TouchRequest& request) {
  TouchSites found;
  std::vector<Point<Patient>> border = border_voxels(model, structure);
  if (border.empty()) {
    found.why_none = cover_of(model, structure);
    return found;
  }

  // voxels near the requested place
  const bool anywhere = !request.landmark && request.near.empty();
  if (!anywhere) {
    std::vector<std::pair<double, Point<Patient>>> by_deviation;
    double smallest = std::numeric_limits<double>::infinity();
    for (const Point<Patient>& p : border) {
      by_deviation.emplace_back(deviation_mm(request, p), p);
      smallest = std::min(smallest, by_deviation.back().first);
    }
    border.clear();
    for (const auto& [mm, p] : by_deviation)
      if (mm <= smallest + kPositionTolerance_mm) border.push_back(p);
  }
  std::vector<SurfaceCandidate> candidates =
      surface_candidates(model, structure, border, request.clearance_mm);
  if (candidates.empty()) {
    found.why_none = anywhere ? "it is covered, or too thin to be pressed"
                              : "there is no surface that can be pressed within 5 mm of the requested place";
    return found;
  }
  if (!anywhere) {
    const double best = candidates.front().score;
    for (SurfaceCandidate& c : candidates)
      c.score = -deviation_mm(request, c.surface.point) + kSuitabilityBonus_mm * c.score / best;
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const auto& a, const auto& b) { return a.score > b.score; });
  }

  // places with a free segment: along the normal if any is free, otherwise tilted
  const FinalSegment final_segment(model, free_space, structure, request.clearance_mm);
  const double separation_mm = anywhere ? kSeparation_mm : kRequestedSeparation_mm;
  const NoGoRegion* no_go = nullptr;  // last region that excludes a place with a free path
  const auto add = [&](const SurfacePoint& surface, const Vector<Patient>& from) {
    auto site = final_segment.along(surface, from);
    if (site)
      if (const NoGoRegion* region =
              no_go_at(model, surface.point + from * tool_reach_mm(model.tool_of(0)))) {
        no_go = region;
        site.reset();
      }
    if (site) found.sites.push_back(*site);
    return site.has_value();
  };
  const auto is_near_another = [&](const SurfacePoint& surface) {
    return std::any_of(found.sites.begin(), found.sites.end(), [&](const TouchSite& site) {
      return (site.surface.point - surface.point).norm() < separation_mm;
    });
  };
  for (const bool tilted : {false, true}) {
    if (tilted && (request.from || !found.sites.empty())) break;
    for (const SurfaceCandidate& c : candidates) {
      if (found.sites.size() == kMaxPoints) break;
      const Vector<Patient>& n = c.surface.normal;
      if (is_near_another(c.surface)) continue;
      if (request.from) {
        if (request.from->dot(n) >= kMinFacing) add(c.surface, *request.from);
      } else if (!tilted) {
        add(c.surface, n);
      } else {
        for (const Vector<Patient>& t : directions_around<kTouchRim>(n))
          if (add(c.surface, n * std::cos(kTilt) + t * std::sin(kTilt))) break;
      }
    }
  }
  if (!found.sites.empty()) return found;
  const std::string what = anywhere ? "it" : "a place within 5 mm of the requested one";
  if (no_go != nullptr) {
    found.why_none = "the no-go region " + no_go->name + " keeps the tool away from " + what;
    return found;
  }
  const LabelId obstacle = in_front_of(model, structure, candidates);
  found.why_none = "there is no free path to " + what + (request.from ? " from that direction" : "") +
                   (obstacle != 0 ? ": " + model.name_of(obstacle) + " is in front of it" : "");
  return found;
}

LabelId contact_structure_near(const Model& model, const Point<Patient>& point) {
  const Bricks<LabelId>& labels = *model.labels;
  const GridGeometry& grid = labels.geometry();
  const Transform<Patient, Voxel> X_PatientVoxel = grid.X_PatientVoxel();
  const Point<Voxel> at = X_PatientVoxel.inverse() * point;
  std::array<int, 3> low{}, high{};
  for (int axis = 0; axis < 3; ++axis) {
    const double reach = kPositionTolerance_mm / grid.spacing_mm[axis] + 1;
    const double last = grid.dims[axis] - 1;
    low[axis] = static_cast<int>(std::clamp(std::floor(at[axis] - reach), 0.0, last));
    high[axis] = static_cast<int>(std::clamp(std::ceil(at[axis] + reach), 0.0, last));
  }
  LabelId nearest = 0;
  double min_mm = kPositionTolerance_mm;
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int i = low[0]; i <= high[0]; ++i) {
        const LabelId label = labels.at(i, j, k);
        if (!model.is_touchable(label)) continue;
        const double mm = (X_PatientVoxel * Point<Voxel>(i, j, k) - point).norm();
        if (mm > min_mm) continue;
        min_mm = mm;
        nearest = label;
      }
  return nearest;
}

}  // namespace palpate
