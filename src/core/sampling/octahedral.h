#pragma once

#include <Eigen/Core>

namespace palpate::internal {

/// Direction as a point of the unfolded octahedron, in integers from -levels to levels.
struct OctahedralCode {
  int a = 0, b = 0;
  bool operator==(const OctahedralCode&) const = default;
};

/// Octahedral map of Cigolle et al. 2014 (section 3.1, "oct", precise variant): n / |n|_1 projected along z
/// onto the square |a|, |b| <= levels, with the lower half folded outward; of the four codes around that
/// point the one whose direction is nearest to n.
/// @param n  unit vector
OctahedralCode encode_octahedral(const Eigen::Vector3d& n, int levels);

/// Unit direction of a code.
Eigen::Vector3d decode_octahedral(const OctahedralCode& code, int levels);

}  // namespace palpate::internal
