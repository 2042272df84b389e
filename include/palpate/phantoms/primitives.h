#pragma once

#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/volume.h"

/// Geometric primitives, voxelised: the founding work's third kind of data, and the ground truth of the
/// tests. A Shape is an immutable value; copies share their content. Radii and extents must be positive
/// and everything finite: shapes come from code, so anything else is a bug and stops by name.
namespace palpate {

class Shape {
 public:
  /// Signed distance to the surface in mm, negative inside. Exact for every primitive; for the
  /// ellipsoid by iteration, to 1e-9 mm. For a union the minimum, for an intersection or difference the
  /// maximum of the operands' distances: exact outside a union, inside an intersection and wherever one
  /// operand alone is nearest, elsewhere never farther from zero than the true distance (blends too).
  /// Changes by at most 1 mm per mm everywhere (Lipschitz 1).
  double distance_mm(const Point<Patient>& p) const;
  /// Outward unit normal: the gradient of the distance. On a medial set, where it is not defined,
  /// any unit vector of the nearest surface.
  Vector<Patient> normal(const Point<Patient>& p) const;

  static Shape sphere(const Point<Patient>& centre, double radius_mm);
  /// radii along the columns of `axes` (orthonormal).
  static Shape ellipsoid(const Point<Patient>& centre, const Eigen::Vector3d& radii_mm,
                         const Eigen::Matrix3d& axes = Eigen::Matrix3d::Identity());
  static Shape capsule(const Point<Patient>& a, const Point<Patient>& b, double radius_mm);
  static Shape box(const Point<Patient>& centre, const Eigen::Vector3d& half_extents_mm,
                   const Eigen::Matrix3d& axes = Eigen::Matrix3d::Identity());
  /// Finite cylinder with flat caps between a and b.
  static Shape cylinder(const Point<Patient>& a, const Point<Patient>& b, double radius_mm);
  static Shape torus(const Point<Patient>& centre, const Vector<Patient>& axis, double major_radius_mm,
                     double minor_radius_mm);
  /// Everything on the side of `point` that `outward_normal` points away from.
  static Shape half_space(const Point<Patient>& point, const Vector<Patient>& outward_normal);
  /// At least one shape.
  static Shape unite(std::vector<Shape> shapes);
  /// `from` without `what`. With a rounding, edges are taken off: where the distances of the two surfaces
  /// differ by less than `rounding_mm` their maximum is raised smoothly, by a quarter of it where they are
  /// equal.
  static Shape subtract(const Shape& from, const Shape& what, double rounding_mm = 0);
  /// Common part, rounded in the same way.
  static Shape intersect(const Shape& a, const Shape& b, double rounding_mm = 0);
  /// Union with its creases filled in the same way, one shape after the other.
  static Shape blend(const std::vector<Shape>& shapes, double width_mm);
  /// The shape grown outward by `margin_mm` (negative shrinks): its distance minus the margin.
  static Shape offset(const Shape& shape, double margin_mm);

  struct Node;
  explicit Shape(std::shared_ptr<const Node> node);
  const std::shared_ptr<const Node>& node() const { return node_; }

 private:
  std::shared_ptr<const Node> node_;
};

/// Fraction of each voxel that the shape covers, 0 ... 1. Voxels that the surface may cross are
/// counted at subsamples^3 points, 1 ... 16 per axis; the others are 0 or 1 exactly.
Result<Volume<float>> voxelize_coverage(const Shape& shape, const GridGeometry& grid, int subsamples = 4,
                                        const Progress& progress = {});
/// Voxels whose centre lies inside, as `label`, 0 elsewhere.
Result<Volume<LabelId>> voxelize_binary(const Shape& shape, const GridGeometry& grid, LabelId label = 1,
                                        const Progress& progress = {});

}  // namespace palpate
