#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/sampling/surface.h"

/// Exact distance from any point to a surface and the nearest point on it. Unlike the surface's own distance
/// field it is not clamped, and it is correct near medial planes, where an interpolated distance is not.
namespace palpate {

/// Nearest point of a surface to a query point.
struct NearestSurfacePoint {
  double distance_mm = 0;   ///< Signed distance of the query point; positive outside, negative inside
  Point<Patient> position;  ///< Nearest point on the surface
};

namespace internal {

/// Bounding cylinder of a piece of the surface.
struct BoundingCylinder {
  std::array<float, 3> middle, normal;  ///< Centre, mm in the patient frame; unit axis
  float half_mm, radius_mm;             ///< Half height along the normal; radius
};
/// Node of a tree. An inner node has the children `first` and `first` + 1. A leaf has `first` < 0: in a
/// brick's tree the centre of its bounds lies on the surface; in the tree above the bricks ~first is an
/// index into top_leaves_.
struct TreeNode {
  BoundingCylinder bounds;
  std::int32_t first;
};
/// Tree of the surface pieces in one brick of voxels, root first.
struct BrickTree {
  std::vector<TreeNode> nodes;
};

}  // namespace internal

/// Bounding volume hierarchy of a surface, for nearest-point queries. The surface is the one used for
/// contact: the zero set of the trilinear interpolant Surface::distance_mm(). Leaves are the voxel cells that
/// it crosses, cut into pieces of at most kPiece_mm along each axis; each has a point on the surface and a
/// bounding cylinder. A query descends depth-first, nearer child first, into cylinders that may contain a
/// point nearer than the best so far by more than kSlack_mm. In a leaf it refines the point by sliding along
/// the tangent plane and projecting back by Newton's method on the interpolant, until the distance no longer
/// decreases.
///
/// Immutable. A query is stateless, does not allocate, lock or throw, and is bit-identical in every build.
class SurfaceTree {
 public:
  /// @param surface  not null
  explicit SurfaceTree(std::shared_ptr<const Surface> surface);
  /// A tree of another version of the surface on the same grid; bricks shared by both versions are reused.
  SurfaceTree with(std::shared_ptr<const Surface> surface) const;

  const std::shared_ptr<const Surface>& surface() const { return surface_; }
  /// Nearest point of the surface. Empty if x is outside and farther than `within_mm`, if there is no
  /// surface, or if x is not finite. Bounded work: after kMaxNodes nodes the best point so far is returned.
  std::optional<NearestSurfacePoint> nearest(
      const Point<Patient>& x, double within_mm = std::numeric_limits<double>::infinity()) const;
  /// Unit gradient of the distance at x. Close to the surface, where the direction to the nearest point is
  /// ill-conditioned, the surface's own normal is used. Zero where neither is defined.
  /// @param near  result of nearest() for x
  Vector<Patient> outward(const Point<Patient>& x, const NearestSurfacePoint& near) const;

  /// Bounding box of the surface; low > high if there is none.
  const Eigen::Array3d& low() const { return low_; }
  const Eigen::Array3d& high() const { return high_; }
  std::size_t pieces() const { return pieces_; }
  std::size_t bytes() const;

  static constexpr double kPiece_mm = 0.8;   ///< Maximum edge of a piece
  static constexpr double kSlack_mm = 0.02;  ///< Tolerance of a query's distance
  static constexpr int kMaxNodes = 1 << 10;  ///< Work limit of a query

 private:
  void update_bricks(const SurfaceTree* before);

  std::shared_ptr<const Surface> surface_;
  // indexed by the distance field's brick number; null: not crossed by the surface
  std::vector<std::shared_ptr<const internal::BrickTree>> bricks_;
  std::vector<internal::TreeNode> top_;
  std::vector<const internal::BrickTree*> top_leaves_;  // tree of the brick at each leaf of top_
  Eigen::Array3d low_, high_;
  std::size_t pieces_ = 0;
};

}  // namespace palpate
