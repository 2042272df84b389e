#include "palpate/contact/distances.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "palpate/base/check.h"

namespace palpate {
namespace {

/// Evaluates points on the axes of tool parts and records the nearest.
class NearestOfTool {
 public:
  NearestOfTool(const SurfaceTree& tree, const Point<Patient>& tip, double within_mm)
      : tree_(tree), tip_(tip), within_mm_(within_mm) {
    nearest_.distance_mm = within_mm;
  }

  void accumulate(const ToolPart& part) {
    count_ = 0;
    const double length_mm = part.axis_mm.norm();
    if (!(length_mm > 0)) {
      accumulate(part, 0, 0);
      return;
    }
    // Lipschitz bound of the clearance over the whole axis
    const double whole_mm = length_mm + std::abs(part.radius_change_mm);
    if (!accumulate(part, 0.5, 0.5 * whole_mm)) return;
    accumulate(part, 0, 0);
    accumulate(part, 1, 0);
    project_nearest(part, length_mm);
    sample_between(part, whole_mm);
  }

  std::optional<ToolDistance> nearest() const { return found_ ? std::optional(nearest_) : std::nullopt; }

 private:
  struct AxisSample {
    double axis_fraction, distance_mm;  // lower bound if no surface is near
    std::optional<Point<Patient>> on_surface;
  };

  // fixed-point iteration: projects the nearest surface point onto the axis and evaluates there
  void project_nearest(const ToolPart& part, double length_mm) {
    constexpr int kMaxProjections = 4;
    constexpr double kConverged_mm = 0.01;
    for (int n = 0; n < kMaxProjections; ++n) {
      const auto best =
          std::min_element(samples_.begin(), samples_.begin() + count_,
                           [](const auto& a, const auto& b) { return a.distance_mm < b.distance_mm; });
      if (!best->on_surface) return;
      const Vector<Patient> displacement = *best->on_surface - (tip_ + part.offset_mm);
      const double axis_fraction =
          std::clamp(displacement.dot(part.axis_mm) / (length_mm * length_mm), 0.0, 1.0);
      if (std::abs(axis_fraction - best->axis_fraction) * length_mm < kConverged_mm) return;
      accumulate(part, axis_fraction, 0);
    }
  }

  // bisects the interval with the smallest lower bound until it cannot contain a nearer point
  void sample_between(const ToolPart& part, double whole_mm) {
    while (count_ < kMaxAxisPoints) {
      const auto min_mm = [&](std::size_t n) {
        const AxisSample &from = samples_[n], &to = samples_[n + 1];
        return 0.5 * (from.distance_mm + to.distance_mm - (to.axis_fraction - from.axis_fraction) * whole_mm);
      };
      std::size_t next = 0;
      for (std::size_t n = 1; n + 1 < count_; ++n)
        if (min_mm(n) < min_mm(next)) next = n;
      if (!(min_mm(next) < nearest_.distance_mm - kAxisTolerance_mm)) return;
      const double half = 0.5 * (samples_[next + 1].axis_fraction - samples_[next].axis_fraction);
      accumulate(part, samples_[next].axis_fraction + half, half * whole_mm);
    }
  }

  // evaluates one point; true if a surface is within reach; keeps the points sorted along the axis
  bool accumulate(const ToolPart& part, double axis_fraction, double farther_mm) {
    const Point<Patient> centre = tip_ + part.offset_mm + part.axis_mm * axis_fraction;
    const double radius_mm = part.radius_at_mm(axis_fraction);
    const auto near = tree_.nearest(centre, within_mm_ + radius_mm + farther_mm);
    AxisSample here{axis_fraction, within_mm_ + farther_mm, {}};
    if (near) {
      here = {axis_fraction, near->distance_mm - radius_mm, near->position};
      if (here.distance_mm < nearest_.distance_mm) {
        nearest_ = {here.distance_mm, centre, radius_mm, *near};
        found_ = true;
      }
    }
    const auto end = samples_.begin() + count_;
    const auto at = std::upper_bound(samples_.begin(), end, here, [](const auto& a, const auto& b) {
      return a.axis_fraction < b.axis_fraction;
    });
    std::move_backward(at, end, end + 1);
    *at = here;
    ++count_;
    return near.has_value();
  }

  const SurfaceTree& tree_;
  const Point<Patient> tip_;
  const double within_mm_;
  std::array<AxisSample, kMaxAxisPoints> samples_{};
  std::size_t count_ = 0;
  ToolDistance nearest_;
  bool found_ = false;
};

}  // namespace

DistanceTrees::Box DistanceTrees::box_of(const SurfaceTree& tree) {
  const Eigen::Array3d &low = tree.low(), &high = tree.high();
  return {low[0], low[1], low[2], high[0], high[1], high[2]};
}

DistanceTrees::DistanceTrees(std::vector<TrackedStructure> structures, double reach_mm)
    : structures_(std::move(structures)), reach_mm_(reach_mm) {
  for (const TrackedStructure& structure : structures_) {
    PALPATE_CHECK(structure.tree != nullptr);
    boxes_.push_back(box_of(*structure.tree));
  }
}

DistanceTrees DistanceTrees::with(std::size_t structure, std::shared_ptr<const Surface> surface) const {
  DistanceTrees now = *this;
  auto& tree = now.structures_[structure].tree;
  tree = std::make_shared<const SurfaceTree>(tree->with(std::move(surface)));
  now.boxes_[structure] = box_of(*tree);
  return now;
}

std::optional<ToolDistance> distance_of_tool(const SurfaceTree& tree, std::span<const ToolPart> parts,
                                             const Point<Patient>& tip, double within_mm) {
  NearestOfTool all(tree, tip, within_mm);
  for (const ToolPart& part : parts) all.accumulate(part);
  return all.nearest();
}

ToolBox box_of_tool(std::span<const ToolPart> parts, const Point<Patient>& tip) {
  ToolBox box;
  box.low.setConstant(std::numeric_limits<double>::infinity());
  box.high = -box.low;
  for (const ToolPart& part : parts)
    for (const double fraction : {0.0, 1.0}) {
      const Eigen::Array3d at = (tip + part.offset_mm + part.axis_mm * fraction).eigen().array();
      box.low = box.low.min(at - part.radius_at_mm(fraction));
      box.high = box.high.max(at + part.radius_at_mm(fraction));
    }
  return box;
}

std::array<NearStructure, kMaxNearReported> nearest_structures(const DistanceTrees& trees,
                                                               std::span<const ToolPart> parts,
                                                               const Point<Patient>& tip) {
  std::array<NearStructure, kMaxNearReported> nearest;
  const ToolBox tool = box_of_tool(parts, tip);
  const std::vector<TrackedStructure>& structures = trees.structures();
  std::size_t count = 0;
  // Structures whose boxes are nearest are evaluated first: once the list is full, its last distance bounds
  // the search for the others.
  double within_mm = trees.reach_mm(), sampled_mm = -1;
  for (const double fraction : {0.1, 0.4, 1.0}) {
    const double ring_mm = fraction * trees.reach_mm();
    for (std::size_t s = 0; s < structures.size(); ++s) {
      if (!structures[s].reported) continue;
      const double min_mm = trees.lower_bound_mm(s, tool);
      if (!(min_mm > sampled_mm && min_mm <= std::min(ring_mm, within_mm))) continue;
      const auto near = distance_of_tool(*structures[s].tree, parts, tip, within_mm);
      if (!near || !(near->distance_mm <= within_mm)) continue;
      const NearStructure here{structures[s].label, near->distance_mm};
      const auto end = nearest.begin() + static_cast<std::ptrdiff_t>(count);
      const auto insertion = std::upper_bound(nearest.begin(), end, here, [](const auto& a, const auto& b) {
        return a.distance_mm < b.distance_mm;
      });
      if (insertion == nearest.end()) continue;
      if (count < nearest.size()) ++count;
      std::move_backward(insertion, nearest.begin() + static_cast<std::ptrdiff_t>(count) - 1,
                         nearest.begin() + static_cast<std::ptrdiff_t>(count));
      *insertion = here;
      if (count == nearest.size()) within_mm = nearest.back().distance_mm;
    }
    sampled_mm = ring_mm;
  }
  return nearest;
}

}  // namespace palpate
