#pragma once

#include <cstddef>
#include <cstdint>

namespace palpate::internal {

/// Points that are sampled together; a multiple of every target's lanes.
inline constexpr std::size_t kPointsInGroup = 32;

/// A group of points between the steps of central_differences_batch.cc.
struct alignas(64) PointGroup {
  const void* cell[kPointsInGroup];                               ///< the voxel before the cell along i
  float u[kPointsInGroup], v[kPointsInGroup], w[kPointsInGroup];  ///< place in the cell
  float value[kPointsInGroup], gi[kPointsInGroup], gj[kPointsInGroup], gk[kPointsInGroup];
};

}  // namespace palpate::internal
