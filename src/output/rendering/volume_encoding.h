#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/rendering/volume_renderer.h"
#include "rendering/section_volumes.h"
#include "rendering/volume_simd.h"

/// Encoding of a volume's visible voxels in the traversal order of a view.
///
///    labels, looks -> extinction, colour, normal of each voxel (volume_terms.h)     once, and on changes
///        -> rows of blocks of eight voxels along one axis; empty blocks are not stored
///            -> lit blocks: extinction and radiance      per viewing direction, on demand (volume_simd.h)
///
/// Rows are never parallel to the viewing direction: rows along i serve views along j and k, rows along j
/// those along i. A block is a cache line.
namespace palpate::internal::volume_picture {

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

  int blocks_ = 0, words_ = 0, groups_ = 0;       ///< Per row
  section::HugePageVector<std::uint32_t> first_;  ///< As in RowsView
  section::HugePageVector<std::uint8_t> room_;    ///< Capacity of each group, in blocks
  section::HugePageVector<std::uint64_t> mask_;
  section::HugePageVector<VoxelBlock> voxels_;
};

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
  section::HugePageVector<std::uint64_t> filled_;
  section::HugePageVector<std::uint8_t> skip_;
};

/// Blocks of voxels for both row directions, and the map of empty space, of one labelled volume and
/// appearance.
class VolumeEncoding {
 public:
  explicit VolumeEncoding(const GridGeometry& grid, std::span<const StructureAppearance> appearances,
                          ScanAppearance scan = {});
  /// Rebuilds the blocks of all voxels whose look depends on labels in a box. Errors: kInterrupted.
  Result<void> encode(const Bricks<LabelId>& labels, const VoxelBox& box, int threads,
                      const Progress& progress);

  const GridGeometry& grid() const { return grid_; }
  /// @param axis  principal axis of the view
  const BlockRows& rows_for(int axis) const { return rows_[axis == 0 ? 1 : 0]; }
  const EmptySpaceMap& skips() const { return skips_; }
  std::size_t bytes() const { return rows_[0].bytes() + rows_[1].bytes() + skips_.bytes(); }

 private:
  class Tile;

  GridGeometry grid_;
  std::vector<StructureAppearance> appearances_;
  ScanAppearance scan_;
  Eigen::Matrix3d to_patient_;                 ///< Transforms a gradient per voxel to one per mm
  std::array<std::vector<float>, 3> kernels_;  ///< Smoothing of the opacity along i, j, k
  std::array<BlockRows, 2> rows_;
  EmptySpaceMap skips_;
  bool is_new_ = true;
};

}  // namespace palpate::internal::volume_picture
