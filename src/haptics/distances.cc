#include "palpate/haptics/distances.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/base/check.h"

namespace palpate {
namespace {

/// A place of a tool's part with its distance; of one that nothing is near, the least that it can be.
struct PlaceOnTool {
  double part = 0;
  double distance_mm = 0;
};

/// Looks at places of one part after the other and keeps the nearest.
class NearestOfTool {
 public:
  NearestOfTool(const SurfaceTree& tree, const Point<Patient>& tip, double within_mm)
      : tree_(tree), tip_(tip), within_mm_(within_mm) {
    nearest_.distance_mm = within_mm;
  }

  void look_at(const ToolSphere& sphere) {
    const double length_mm = sphere.along_mm.norm();
    const PlaceOnTool from = at(sphere, 0);
    if (!(length_mm > 0)) return;
    // places' distances differ by no more than this for the whole axis
    const double whole_mm = length_mm + std::abs(sphere.widens_mm);
    struct Stretch {
      PlaceOnTool from, to;
    };
    std::array<Stretch, kMostAlong> open;
    std::size_t count = 0;
    open[count++] = {from, at(sphere, 1)};
    for (int looked = 2; count > 0 && looked < kMostAlong; ++looked) {
      // the one that may hold the nearest place of all
      const auto least = [&](const Stretch& s) {
        return 0.5 * (s.from.distance_mm + s.to.distance_mm - (s.to.part - s.from.part) * whole_mm);
      };
      const auto next = std::min_element(open.begin(), open.begin() + count,
                                         [&](const auto& a, const auto& b) { return least(a) < least(b); });
      if (!(least(*next) < nearest_.distance_mm - kAlongSlack_mm)) return;
      const Stretch stretch = *next;
      const PlaceOnTool middle = at(sphere, 0.5 * (stretch.from.part + stretch.to.part));
      *next = {stretch.from, middle};
      open[count++] = {middle, stretch.to};
    }
  }

  std::optional<ToolDistance> nearest() const { return found_ ? std::optional(nearest_) : std::nullopt; }

 private:
  PlaceOnTool at(const ToolSphere& sphere, double part) {
    const Point<Patient> centre = tip_ + sphere.offset_mm + sphere.along_mm * part;
    const double radius_mm = sphere.radius_at_mm(part);
    const auto near = tree_.nearest(centre, within_mm_ + radius_mm);
    if (!near) return {part, within_mm_};
    const double distance_mm = near->distance_mm - radius_mm;
    if (distance_mm < nearest_.distance_mm) {
      nearest_ = {distance_mm, centre, radius_mm, *near};
      found_ = true;
    }
    return {part, distance_mm};
  }

  const SurfaceTree& tree_;
  const Point<Patient> tip_;
  const double within_mm_;
  ToolDistance nearest_;
  bool found_ = false;
};

}  // namespace

Distances::Box Distances::box_of(const SurfaceTree& tree) {
  const Eigen::Array3d &low = tree.low(), &high = tree.high();
  return {low[0], low[1], low[2], high[0], high[1], high[2]};
}

Distances::Distances(std::vector<TrackedStructure> structures, double reach_mm)
    : structures_(std::move(structures)), reach_mm_(reach_mm) {
  for (const TrackedStructure& structure : structures_) {
    PALPATE_CHECK(structure.tree != nullptr);
    boxes_.push_back(box_of(*structure.tree));
  }
}

Distances Distances::with(std::size_t structure, std::shared_ptr<const Surface> surface) const {
  Distances now = *this;
  auto& tree = now.structures_[structure].tree;
  tree = std::make_shared<const SurfaceTree>(tree->with(std::move(surface)));
  now.boxes_[structure] = box_of(*tree);
  return now;
}

std::optional<ToolDistance> distance_of_tool(const SurfaceTree& tree, std::span<const ToolSphere> spheres,
                                             const Point<Patient>& tip, double within_mm) {
  NearestOfTool all(tree, tip, within_mm);
  for (const ToolSphere& sphere : spheres) all.look_at(sphere);
  return all.nearest();
}

double reach_of_tool(std::span<const ToolSphere> spheres) {
  double reach_mm = 0;
  for (const ToolSphere& sphere : spheres)
    reach_mm = std::max({reach_mm, sphere.offset_mm.norm() + sphere.radius_at_mm(0),
                         (sphere.offset_mm + sphere.along_mm).norm() + sphere.radius_at_mm(1)});
  return reach_mm;
}

std::array<NearStructure, kMostNearTold> nearest_structures(const Distances& distances,
                                                            std::span<const ToolSphere> spheres,
                                                            const Point<Patient>& tip) {
  std::array<NearStructure, kMostNearTold> told;
  const double tool_mm = reach_of_tool(spheres);
  const std::vector<TrackedStructure>& structures = distances.structures();
  std::size_t count = 0;
  // of more than there is room for, what is farther than the last need not be known
  double within_mm = distances.reach_mm();
  for (std::size_t s = 0; s < structures.size(); ++s) {
    if (!structures[s].told || !(distances.at_least_mm(s, tip) <= within_mm + tool_mm)) continue;
    const auto near = distance_of_tool(*structures[s].tree, spheres, tip, within_mm);
    if (!near || !(near->distance_mm <= within_mm)) continue;
    const NearStructure here{structures[s].label, near->distance_mm};
    const auto end = told.begin() + static_cast<std::ptrdiff_t>(count);
    const auto place = std::upper_bound(told.begin(), end, here, [](const auto& a, const auto& b) {
      return a.distance_mm < b.distance_mm;
    });
    if (count < told.size()) ++count;
    std::move_backward(place, told.begin() + static_cast<std::ptrdiff_t>(count) - 1,
                       told.begin() + static_cast<std::ptrdiff_t>(count));
    *place = here;
    if (count == told.size()) within_mm = told.back().distance_mm;
  }
  return told;
}

}  // namespace palpate
