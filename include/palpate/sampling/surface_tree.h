#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/sampling/surface.h"

/// How far a surface is from any point, and where it is nearest: farther than the surface's own distance
/// reaches, and right on medial planes, where a distance that is interpolated between voxels is not.
namespace palpate {

/// The place of a surface that is nearest to a point.
struct NearestPlace {
  double distance_mm = 0;  ///< from the point: positive outside, negative inside
  Point<Patient> place;    ///< on the surface
};

namespace internal {

/// A flat cylinder that a piece of the surface lies in.
struct Disc {
  std::array<float, 3> middle, normal;  ///< mm in the patient; unit
  float half_mm, radius_mm;             ///< half its height, along the normal; its radius
};
/// Of a tree: an inner node's children are `first` and `first` + 1. A leaf has `first` < 0: in a brick its
/// middle lies on the surface, above the bricks ~first is the brick's number among those that have any.
struct DiscNode {
  Disc disc;
  std::int32_t first;
};
/// The pieces of the surface in one brick of voxels, the root first.
struct BrickOfDiscs {
  std::vector<DiscNode> nodes;
};

}  // namespace internal

/// A surface as a tree of its pieces. What counts as the surface is what contact leans on: the places where
/// Surface::distance_mm() is 0, of the trilinear interpolant between the voxels. Every cell of voxels through
/// which it passes, cut into pieces of at most kPiece_mm along each axis, is a leaf: a place on the surface,
/// and a flat cylinder that all of the piece lies in. A query goes down to the cylinders that can hold
/// something nearer than what was found so far by more than kSlack_mm (bounding volume hierarchy, depth
/// first, the nearer child first), and settles there: along the tangent plane and back to the surface, by
/// Newton's method on the interpolant itself, until nothing is nearer.
///
/// Immutable. A query allocates, locks and throws nothing, remembers nothing, and gives the same bits in
/// every build.
class SurfaceTree {
 public:
  /// @param surface  not null
  explicit SurfaceTree(std::shared_ptr<const Surface> surface);
  /// Of another version of the surface, on the same grid: bricks of voxels that both versions share are not
  /// looked at again.
  SurfaceTree with(std::shared_ptr<const Surface> surface) const;

  const std::shared_ptr<const Surface>& surface() const { return surface_; }
  /// The surface's nearest place; none where x is outside and farther than `within_mm`, where there is no
  /// surface, and where x is not finite. Bounded: it looks at kMostNodes of the tree at most, and then has
  /// the nearest of what it saw.
  std::optional<NearestPlace> nearest(const Point<Patient>& x,
                                      double within_mm = std::numeric_limits<double>::infinity()) const;
  /// Unit: along it the distance grows fastest at x. On the surface, where no way from it tells a direction,
  /// the surface's own normal. Zero where neither does.
  /// @param near  what nearest() says of x
  Vector<Patient> outward(const Point<Patient>& x, const NearestPlace& near) const;

  /// A box around all of it; low above high where there is no surface.
  const Eigen::Array3d& low() const { return low_; }
  const Eigen::Array3d& high() const { return high_; }
  std::size_t pieces() const { return pieces_; }
  std::size_t bytes() const;

  static constexpr double kPiece_mm = 0.8;
  static constexpr double kSlack_mm = 0.02;
  static constexpr int kMostNodes = 1 << 10;

 private:
  void look_at_bricks(const SurfaceTree* before);

  std::shared_ptr<const Surface> surface_;
  // by number of the position's brick; null: the surface does not pass through it
  std::vector<std::shared_ptr<const internal::BrickOfDiscs>> bricks_;
  std::vector<internal::DiscNode> top_;
  std::vector<const internal::BrickOfDiscs*> of_top_;  // of its leaves
  Eigen::Array3d low_, high_;
  std::size_t pieces_ = 0;
};

}  // namespace palpate
