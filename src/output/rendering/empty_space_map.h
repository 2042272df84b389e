#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "rendering/block_rows.h"

namespace palpate::internal::volume_picture {

/// Empty-space skipping for rays.
class EmptySpaceMap {
 public:
  EmptySpaceMap() = default;
  explicit EmptySpaceMap(const GridGeometry& grid);
  /// Updates from the voxels of a box, using rows along i.
  void update(const BlockRows& rows, const VoxelBox& box);
  /// @param x, y, z  axes of the grid in the order of a view
  CubesView view(int x, int y, int z) const;
  std::size_t bytes() const { return skip_.size() * (sizeof(skip_[0]) + sizeof(filled_[0])); }

 private:
  using Cubes = std::array<std::array<int, 2>, 3>;  ///< First and last cube per axis
  std::size_t index(int a, int b, int c) const {
    return static_cast<std::size_t>(a) +
           static_cast<std::size_t>(cubes_[0]) *
               (static_cast<std::size_t>(b) +
                static_cast<std::size_t>(cubes_[1]) * static_cast<std::size_t>(c));
  }
  /// Determines the non-empty cells of these cubes.
  void fill(const BlockRows& rows, const Cubes& cubes);
  /// One pass of the distance transform: lowers the skips to the bounds given by the cubes already visited.
  void pass(const Cubes& region, int step);

  std::array<int, 3> voxels_{}, cubes_{};
  HugePageVector<std::uint64_t> filled_;
  HugePageVector<std::uint8_t> skip_;
};

}  // namespace palpate::internal::volume_picture
