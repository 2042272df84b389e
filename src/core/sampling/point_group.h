#pragma once

#include <cstddef>
#include <cstdint>

namespace palpate::internal {

/// Number of points sampled together; a multiple of every target's lane count.
inline constexpr std::size_t kPointsInGroup = 32;

/// Points between the stages of central_differences_batch.cc.
struct alignas(64) PointGroup {
  const void* cell[kPointsInGroup];  ///< address of the voxel before the cell along i
  float u[kPointsInGroup], v[kPointsInGroup], w[kPointsInGroup];  ///< fraction in the cell
  float value[kPointsInGroup], gi[kPointsInGroup], gj[kPointsInGroup], gk[kPointsInGroup];
};

}  // namespace palpate::internal
