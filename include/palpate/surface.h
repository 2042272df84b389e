#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "palpate/sampling.h"

/// A structure as a surface, for contact that keeps the tool out.
namespace palpate {

/// A structure's surface: where a signed distance is 0, positive outside, negative inside. It is read from
/// two fields, each on a grid of its own. The position comes from a lightly smoothed distance, so that thin
/// tissue survives; the normal from a broader one, so that it does not show the voxels (docs/decisions/0009).
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

  /// mm, positive outside. Of a place that is none (NaN): as outside the volume.
  double distance_mm(const Point<Patient>& x) const { return sample_value(position_, x); }
  /// Unit vector, or zero where both fields are flat: beyond their reach, or on a medial plane.
  Vector<Patient> outward(const Point<Patient>& x) const {
    const Vector<Patient> slope = sample_central_differences(normal_, x).gradient;
    if (slope != Vector<Patient>()) return slope.normalized();
    return sample_central_differences(position_, x).gradient.normalized();
  }

  const SignedField& position() const { return position_; }
  const SignedField& normal() const { return normal_; }
  double steepest() const { return steepest_; }
  /// Equal for surfaces that are the same everywhere, whenever they were prepared.
  std::uint64_t content_hash() const { return content_hash_; }

 private:
  SignedField position_, normal_;
  double steepest_ = 1;
  std::uint64_t content_hash_ = 0;
};

}  // namespace palpate
