#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "palpate/rendering/volume_renderer.h"
#include "rendering/huge_pages.h"
#include "rendering/volume_simd.h"

namespace palpate::internal::volume_picture {

/// Number of blocks of a row of voxels.
inline int blocks_along(int voxels) {
  return (voxels + kBlock - 1) / kBlock;
}

/// Rows of blocks along an axis, for the whole grid.
class BlockRows {
 public:
  BlockRows() = default;
  /// @param along  axis of the rows: 0 or 1
  BlockRows(const GridGeometry& grid, int along);

  /// Stores a voxel block, or removes it if it is empty.
  /// @param i, j, k  first voxel of the block
  void put(int i, int j, int k, const VoxelBlock& block);
  /// Rows as accumulate_lines() reads them, with the light of a view.
  RowsView view(const VolumeCamera& camera, const VolumeLight& light) const;
  /// Blocks of a row by their number; null for an empty block.
  struct Row {
    const std::uint64_t* mask;
    const std::uint32_t* first;
    const VoxelBlock* voxels;

    const VoxelBlock* operator[](int block) const {
      const std::uint32_t index = slot_of(mask, first, block);
      return index != 0 ? voxels + index : nullptr;
    }
  };
  /// @param across  voxel index across the rows; @param k  slice
  Row row(int across, int k) const {
    const std::size_t number = row_number(across, k);
    return {mask_.data() + number * static_cast<std::size_t>(words_),
            first_.data() + number * static_cast<std::size_t>(groups_), voxels_.data()};
  }
  std::size_t bytes() const;

 private:
  int along_ = 0, across_ = 1;
  std::array<int, 3> dims_{};
  std::size_t row_number(int across, int k) const {
    return static_cast<std::size_t>(across) +
           static_cast<std::size_t>(dims_[static_cast<std::size_t>(across_)]) * static_cast<std::size_t>(k);
  }
  /// Makes room for another block of a group that has `count`.
  void make_room(std::size_t group, int count);

  int blocks_ = 0, words_ = 0, groups_ = 0;  ///< Per row
  HugePageVector<std::uint32_t> first_;      ///< As in RowsView
  HugePageVector<std::uint8_t> room_;        ///< Capacity of each group, in blocks
  HugePageVector<std::uint64_t> mask_;
  HugePageVector<VoxelBlock> voxels_;
};

}  // namespace palpate::internal::volume_picture
