#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/proxy.h"
#include "palpate/device/telemetry.h"
#include "palpate/sampling/surface_tree.h"
#include "palpate/volume/volume.h"

/// Distances of a tool to structures, touchable or not, in every tick.
namespace palpate {

/// Structures whose distances are reported.
struct ReportedDistances {
  std::vector<LabelId> structures;  ///< In ascending order; empty: none
  double reach_mm = 20;             ///< Maximum reported distance of the tool's outline; above 0
};

/// Structure with a distance tree.
struct TrackedStructure {
  LabelId label = 0;
  std::shared_ptr<const SurfaceTree> tree;  ///< Tree of its current surface, after any removal
  bool reported = false;                    ///< Whether its distance is reported in every tick
};

/// Axis-aligned bounding box of a whole tool, mm in the patient frame.
struct ToolBox {
  Eigen::Array3d low, high;
};
/// Bounding box of a tool.
/// @param parts  tool parts in the operator's pose
/// @param tip    position of the tip
ToolBox box_of_tool(std::span<const ToolPart> parts, const Point<Patient>& tip);

/// Structures with distance trees. Immutable value; with() shares the unchanged parts.
class DistanceTrees {
 public:
  DistanceTrees() = default;
  /// @param structures  each with a tree
  /// @param reach_mm    maximum reported distance; above 0
  DistanceTrees(std::vector<TrackedStructure> structures, double reach_mm);
  /// A copy in which one structure has a new version of its surface.
  DistanceTrees with(std::size_t structure, std::shared_ptr<const Surface> surface) const;

  const std::vector<TrackedStructure>& structures() const { return structures_; }
  double reach_mm() const { return reach_mm_; }
  /// Lower bound of the distance of a structure to a tool, from the bounding boxes; 0 if they overlap.
  double lower_bound_mm(std::size_t structure, const ToolBox& tool) const {
    const Box& box = boxes_[structure];
    double beyond2 = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<Eigen::Index>(axis);
      const double beyond = std::max({box[axis] - tool.high[a], tool.low[a] - box[axis + 3], 0.0});
      beyond2 += beyond * beyond;
    }
    return std::sqrt(beyond2);
  }

 private:
  // minimum and maximum coordinates in one array, because every tick reads all boxes
  using Box = std::array<double, 6>;
  static Box box_of(const SurfaceTree& tree);

  std::vector<TrackedStructure> structures_;
  std::vector<Box> boxes_;
  double reach_mm_ = 0;
};

/// Closest approach of a tool to a surface.
struct ToolDistance {
  double distance_mm = 0;    ///< From the tool's outline to the surface; below 0: penetration depth
  Point<Patient> centre;     ///< Point on the axis of the nearest tool part
  double radius_mm = 0;      ///< Radius of that part there
  NearestSurfacePoint near;  ///< Nearest point of the surface to `centre`
};
/// Closest approach of all parts of a tool; empty if the whole tool is outside and farther than `within_mm`.
/// On a capsule's axis at most kMaxAxisPoints points are evaluated: both ends and the middle, then the
/// projections of the nearest surface points onto the axis, then bisection of intervals that may contain a
/// point nearer by more than kAxisTolerance_mm (the distance is Lipschitz continuous along the axis). Bounded
/// work; does not allocate, lock or throw.
/// @param parts  tool parts in the operator's pose
/// @param tip    position of the tip
std::optional<ToolDistance> distance_of_tool(const SurfaceTree& tree, std::span<const ToolPart> parts,
                                             const Point<Patient>& tip, double within_mm);
inline constexpr double kAxisTolerance_mm = 0.02;  ///< Tolerance of distance_of_tool() along an axis
inline constexpr std::size_t kMaxAxisPoints = 16;  ///< Points evaluated per axis

/// Distance of a structure to a tool.
struct NearStructure {
  LabelId label = 0;  ///< 0: none
  double distance_mm = 0;
};
/// Reported structures within DistanceTrees::reach_mm of a tool, nearest first, up to the capacity; unused
/// entries have label 0. The work depends on the number of structures nearby. Does not allocate, lock or
/// throw.
std::array<NearStructure, kMaxNearReported> nearest_structures(const DistanceTrees& trees,
                                                               std::span<const ToolPart> parts,
                                                               const Point<Patient>& tip);

}  // namespace palpate
