#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "palpate/sampling/sampling.h"

/// Surface of a structure for constraint-based contact.
namespace palpate {

/// Surface of a structure: the zero level set of a signed distance, positive outside. Two fields on separate
/// grids represent it. The distance field is the signed distance to a surface net that is as smooth as the
/// labels allow (docs/decisions/0017); the normal field is smoothed more broadly, so that normals show no
/// voxel pattern (docs/decisions/archive/0009). Distances are clamped at the field's reach. Immutable; a
/// query does not allocate, lock or throw.
class Surface {
 public:
  Surface() = default;
  /// @param distance_field  distance in mm, interpolated trilinearly; its value outside the volume is at most
  ///                        the true distance there
  /// @param normal_field    distance in mm of which only the gradient is used
  /// @param max_gradient    maximum slope of the distance field anywhere, including its decrease to the value
  ///                        outside; at least 1, the slope of an exact distance, is used
  Surface(SignedField distance_field, SignedField normal_field, double max_gradient);
  /// A copy with a box of each field replaced (SignedField::with); the rest is shared. The bounding box used
  /// by is_farther_than() is only enlarged, so is_farther_than() stays conservative.
  Surface with(const PatchOf<std::int16_t>& position, const PatchOf<std::int16_t>& normal,
               double max_gradient) const;

  /// Signed distance, mm; positive outside. If x is NaN, the value outside the volume.
  double distance_mm(const Point<Patient>& x) const { return sample_value(distance_field_, x); }
  /// Outward unit normal. Zero where both fields are flat: beyond their reach, or on a medial plane.
  Vector<Patient> outward(const Point<Patient>& x) const {
    const Vector<Patient> slope = sample_central_differences(normal_field_, x).gradient;
    if (slope != Vector<Patient>()) return slope.normalized();
    return sample_central_differences(distance_field_, x).gradient.normalized();
  }

  /// Whether distance_mm() equals outside_mm() up to rounding everywhere within a distance of x.
  /// Conservative, tested by a bounding box: may be false where it is true.
  bool is_farther_than(const Point<Patient>& x, double within_mm) const {
    const Eigen::Array3d away_mm =
        (low_ - x.eigen().array()).max(x.eigen().array() - high_).max(Eigen::Array3d::Zero());
    return away_mm.square().sum() > within_mm * within_mm;
  }
  /// The same within a distance of a box, given by its minimum and maximum coordinates.
  bool is_farther_than(const Eigen::Array3d& low, const Eigen::Array3d& high, double within_mm) const {
    return (low - high_ > within_mm).any() || (low_ - high > within_mm).any();
  }
  double outside_mm() const { return outside_mm_; }
  /// Lower bound of distance_mm(), the minimum over the surrounding block of cells, at a fraction of its
  /// cost.
  double lower_bound_mm(const Point<Patient>& x) const;

  const SignedField& distance_field() const { return distance_field_; }
  const SignedField& normal_field() const { return normal_field_; }
  double max_gradient() const { return max_gradient_; }
  /// Equal for surfaces with equal content, independent of when they were prepared.
  std::uint64_t content_hash() const { return content_hash_; }

 private:
  // inclusive voxel bounds in the distance field; empty if first > last
  struct Voxels {
    std::array<int, 3> first, last;
  };
  void extend_bounds(const Voxels& different);
  void update_block_minimum(std::size_t brick);
  void hash_content();

  // bounding box, in the patient frame, of all points with a distance other than outside_mm_; read by every
  // tick
  Eigen::Array3d low_ = Eigen::Array3d::Zero(), high_ = Eigen::Array3d::Zero();
  double max_gradient_ = 1, outside_mm_ = 0;
  SignedField distance_field_, normal_field_;
  // minimum stored distance of every block of cells; the eight blocks of a brick are consecutive, i fastest
  std::vector<std::int16_t> block_minima_ = std::vector<std::int16_t>(8);
  std::uint64_t content_hash_ = 0;
};

}  // namespace palpate
