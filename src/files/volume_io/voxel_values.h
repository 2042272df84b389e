#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "palpate/volume/volume.h"
#include "volume_io/voxel_source.h"

/// Values of a file's voxels as they are read piece by piece.
namespace palpate::volume_io {

/// Calls value(index, stored value) for each value of a piece.
/// @param first  index of the piece's first value
template <class T, class Value>
void for_each_value(std::uint64_t first, std::span<const std::byte> bytes, const Value& value) {
  for (std::size_t n = 0; n < bytes.size() / sizeof(T); ++n) {
    T stored;
    std::memcpy(&stored, bytes.data() + n * sizeof(T), sizeof(T));
    value(first + n, stored);
  }
}

/// Reserves memory for all voxels without touching it, so that a header that promises more than the file
/// contains does not consume memory. grow_to() commits it progressively from the front.
template <class T>
std::vector<T> unfilled(const GridGeometry& geometry) {
  std::vector<T> voxels;
  voxels.reserve(geometry.voxel_count());
  return voxels;
}

template <class T>
void grow_to(std::vector<T>& voxels, std::uint64_t count) {
  if (count > voxels.size()) voxels.resize(static_cast<std::size_t>(count));
}

/// Whether a value differs from the number that is stored for it.
inline bool is_scaled(const VoxelSource& source) {
  return source.slope != 1 || source.intercept != 0;
}

}  // namespace palpate::volume_io
