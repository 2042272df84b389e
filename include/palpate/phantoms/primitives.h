#pragma once

#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/volume.h"

/// Voxelised geometric primitives: the third kind of data of the founding work, and the ground truth of the
/// tests. A Shape is an immutable value; copies share their content. Radii and extents must be positive and
/// all values finite: shapes are defined in code, so violations are bugs and abort.
namespace palpate {

class Shape {
 public:
  /// Signed distance to the surface; mm, negative inside. Exact for every primitive; for the ellipsoid by
  /// iteration, to 1e-9 mm. A union takes the minimum, an intersection or difference the maximum of the
  /// operands' distances: exact outside a union, inside an intersection, and wherever a single operand is
  /// nearest; elsewhere its magnitude never exceeds that of the true distance (blends too). Lipschitz
  /// continuous with constant 1.
  double distance_mm(const Point<Patient>& p) const;
  /// Outward unit normal: the gradient of the distance. On the medial axis, where it is not defined, any unit
  /// normal of the nearest surface.
  Vector<Patient> normal(const Point<Patient>& p) const;

  static Shape sphere(const Point<Patient>& centre, double radius_mm);
  /// Ellipsoid with radii along the columns of `axes` (orthonormal).
  static Shape ellipsoid(const Point<Patient>& centre, const Eigen::Vector3d& radii_mm,
                         const Eigen::Matrix3d& axes = Eigen::Matrix3d::Identity());
  static Shape capsule(const Point<Patient>& a, const Point<Patient>& b, double radius_mm);
  static Shape box(const Point<Patient>& centre, const Eigen::Vector3d& half_extents_mm,
                   const Eigen::Matrix3d& axes = Eigen::Matrix3d::Identity());
  /// Finite cylinder with flat caps at a and b.
  static Shape cylinder(const Point<Patient>& a, const Point<Patient>& b, double radius_mm);
  static Shape torus(const Point<Patient>& centre, const Vector<Patient>& axis, double major_radius_mm,
                     double minor_radius_mm);
  /// Half-space on the side of `point` opposite to `outward_normal`.
  static Shape half_space(const Point<Patient>& point, const Vector<Patient>& outward_normal);
  /// Union of at least one shape.
  static Shape unite(std::vector<Shape> shapes);
  /// Difference: `from` without `what`. With a rounding, edges are rounded: where the two distances differ by
  /// less than `rounding_mm`, their maximum is raised smoothly, by a quarter of `rounding_mm` where they are
  /// equal.
  static Shape subtract(const Shape& from, const Shape& what, double rounding_mm = 0);
  /// Intersection, with edges rounded as in subtract().
  static Shape intersect(const Shape& a, const Shape& b, double rounding_mm = 0);
  /// Union with creases filled within `width_mm`, applied to one shape after the other.
  static Shape blend(const std::vector<Shape>& shapes, double width_mm);
  /// Shape grown outwards by `margin_mm` (negative: shrunk): its distance minus the margin.
  static Shape offset(const Shape& shape, double margin_mm);

  struct Node;
  explicit Shape(std::shared_ptr<const Node> node);
  const std::shared_ptr<const Node>& node() const { return node_; }

 private:
  std::shared_ptr<const Node> node_;
};

/// Fraction of each voxel covered by the shape, 0 ... 1. Voxels that the surface may intersect are sampled at
/// subsamples^3 points, 1 ... 16 per axis; the others are exactly 0 or 1.
Result<Volume<float>> voxelize_coverage(const Shape& shape, const GridGeometry& grid, int subsamples = 4,
                                        const Progress& progress = {});
/// Labels the voxels whose centre lies inside with `label`, others with 0.
Result<Volume<LabelId>> voxelize_binary(const Shape& shape, const GridGeometry& grid, LabelId label = 1,
                                        const Progress& progress = {});

}  // namespace palpate
