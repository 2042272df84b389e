#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "palpate/sampling/sampling.h"

/// A structure as a surface, for contact that keeps the tool out.
namespace palpate {

/// A structure's surface: where a signed distance is 0, positive outside, negative inside. It is read from
/// two fields, each on a grid of its own. The position is the distance to a net that is as smooth as the
/// labels allow (docs/decisions/0017); the normal is of a broader one, which shows no voxels (0009).
/// Beyond its reach the distance stays at what it is there. Immutable; a query allocates, locks and throws
/// nothing.
class Surface {
 public:
  Surface() = default;
  /// @param position   mm, trilinear; its value outside the volume is at most the true distance there
  /// @param normal     mm; only its gradient counts
  /// @param steepest   the position's greatest slope anywhere, its fall to the value outside included; below
  /// 1
  ///                   counts as 1, an exact distance's
  Surface(SignedField position, SignedField normal, double steepest);
  /// The same but for a box of each field (SignedField::with); shares the rest with this one. Where the
  /// position changes for what is outside, is_beyond() may go on being false.
  Surface with(const PatchOf<std::int16_t>& position, const PatchOf<std::int16_t>& normal,
               double steepest) const;

  /// mm, positive outside. Where x is NaN: as outside the volume.
  double distance_mm(const Point<Patient>& x) const { return sample_value(position_, x); }
  /// Unit vector, or zero where both fields are flat: beyond their reach, or on a medial plane.
  Vector<Patient> outward(const Point<Patient>& x) const {
    const Vector<Patient> slope = sample_central_differences(normal_, x).gradient;
    if (slope != Vector<Patient>()) return slope.normalized();
    return sample_central_differences(position_, x).gradient.normalized();
  }

  /// Whether distance_mm() is outside_mm(), but for rounding, at every place within so many mm of x. Known by
  /// a box around all others: may be false where it is so.
  bool is_beyond(const Point<Patient>& x, double within_mm) const {
    const Eigen::Array3d away_mm =
        (low_ - x.eigen().array()).max(x.eigen().array() - high_).max(Eigen::Array3d::Zero());
    return away_mm.square().sum() > within_mm * within_mm;
  }
  /// The same of every place within so many mm of a box, which is given by its least and greatest
  /// coordinates.
  bool is_beyond(const Eigen::Array3d& low, const Eigen::Array3d& high, double within_mm) const {
    return (low - high_ > within_mm).any() || (low_ - high > within_mm).any();
  }
  double outside_mm() const { return outside_mm_; }
  /// A lower bound of distance_mm() that costs a fraction of it: the least within some voxels of x.
  double at_least_mm(const Point<Patient>& x) const;

  const SignedField& position() const { return position_; }
  const SignedField& normal() const { return normal_; }
  double steepest() const { return steepest_; }
  /// Equal for surfaces that are the same everywhere, whenever they were prepared.
  std::uint64_t content_hash() const { return content_hash_; }

 private:
  // voxels of the position, first to last; empty where one is after the other
  struct Voxels {
    std::array<int, 3> first, last;
  };
  void reach_around(const Voxels& different);
  void find_least(std::size_t brick);
  void hash_content();

  // of all places where the position is not as outside, in the patient; looked at by every tick
  Eigen::Array3d low_ = Eigen::Array3d::Zero(), high_ = Eigen::Array3d::Zero();
  double steepest_ = 1, outside_mm_ = 0;
  SignedField position_, normal_;
  // the position's least step in every block of cells: the eight of a brick after each other, i fastest
  std::vector<std::int16_t> least_ = std::vector<std::int16_t>(8);
  std::uint64_t content_hash_ = 0;
};

}  // namespace palpate
