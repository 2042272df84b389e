#pragma once

#include <Eigen/Core>

namespace palpate::internal {

/// A direction as a place on the unfolded octahedron: whole numbers from -levels to levels.
struct OctahedralCode {
  int a = 0, b = 0;
  bool operator==(const OctahedralCode&) const = default;
};

/// The octahedral map of Cigolle et al. 2014 (section 3.1, "oct", precise variant): n / |n|_1 projected along
/// z onto the square |a|, |b| <= levels, its lower half folded outward; of the four codes around that place
/// the one whose direction is nearest to n. n is a unit vector.
OctahedralCode encode_octahedral(const Eigen::Vector3d& n, int levels);

/// The unit direction of a code.
Eigen::Vector3d decode_octahedral(const OctahedralCode& code, int levels);

}  // namespace palpate::internal
