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

#include "palpate/device/telemetry.h"
#include "palpate/haptics/proxy.h"
#include "palpate/sampling/surface_tree.h"
#include "palpate/volume/volume.h"

/// How far a tool is from structures, felt or not, in every tick.
namespace palpate {

/// Which distances are told.
struct ToldDistances {
  std::vector<LabelId> structures;  ///< ascending; empty: none are
  double reach_mm = 20;             ///< at most so far away, of the tool's outline; above 0
};

/// A structure whose distance is known.
struct TrackedStructure {
  LabelId label = 0;
  std::shared_ptr<const SurfaceTree> tree;  ///< of its own surface, with all that was taken from it
  bool told = false;                        ///< its distance is told in every tick
};

/// Around all of a tool, by its least and greatest coordinates, mm in the patient.
struct ToolBox {
  Eigen::Array3d low, high;
};
/// @param spheres  the tool's, as the hand holds it
ToolBox box_of_tool(std::span<const ToolSphere> spheres, const Point<Patient>& tip);

/// The structures whose distances are known. A version is a value; with() shares what it does not change.
class Distances {
 public:
  Distances() = default;
  /// @param structures  each with a tree
  /// @param reach_mm    what is told is at most so far away; above 0
  Distances(std::vector<TrackedStructure> structures, double reach_mm);
  /// The same but for one structure's surface, which is another version of that one.
  Distances with(std::size_t structure, std::shared_ptr<const Surface> surface) const;

  const std::vector<TrackedStructure>& structures() const { return structures_; }
  double reach_mm() const { return reach_mm_; }
  /// No place of that structure is nearer to a tool in a box; 0: the boxes meet, by which this is known.
  double at_least_mm(std::size_t structure, const ToolBox& tool) const {
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
  // least and greatest coordinates, one after the other: a tick looks at all of them
  using Box = std::array<double, 6>;
  static Box box_of(const SurfaceTree& tree);

  std::vector<TrackedStructure> structures_;
  std::vector<Box> boxes_;
  double reach_mm_ = 0;
};

/// Where a tool is nearest to a surface.
struct ToolDistance {
  double distance_mm = 0;  ///< from the tool's outline to the surface; below 0: the tool reaches into it
  Point<Patient> centre;   ///< on the axis of the part that is nearest
  double radius_mm = 0;    ///< of that part there
  NearestPlace near;       ///< of the centre
};
/// The nearest of all parts of a tool; none where all of it is outside and farther than `within_mm`. Of a
/// capsule's axis at most kMostAlong places are looked at: from both ends and the middle on to where it is
/// nearest to what it is near to, then where it may be nearer by more than kAlongSlack_mm, as distances
/// differ by no more than the way between places does. Bounded work; allocates, locks and throws nothing.
/// @param spheres  the tool's, as the hand holds it
std::optional<ToolDistance> distance_of_tool(const SurfaceTree& tree, std::span<const ToolSphere> spheres,
                                             const Point<Patient>& tip, double within_mm);
inline constexpr double kAlongSlack_mm = 0.02;
inline constexpr std::size_t kMostAlong = 16;

/// A structure near a tool.
struct NearStructure {
  LabelId label = 0;  ///< 0: none
  double distance_mm = 0;
};
/// The told structures within Distances::reach_mm of a tool, nearest first, as many as there is room for;
/// those after the last have label 0. The work goes with what is near. Allocates, locks and throws nothing.
std::array<NearStructure, kMostNearTold> nearest_structures(const Distances& distances,
                                                            std::span<const ToolSphere> spheres,
                                                            const Point<Patient>& tip);

}  // namespace palpate
