#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/rendering/volume_renderer.h"
#include "rendering/section_volumes.h"
#include "rendering/volume_simd.h"

/// What is seen of a volume, in the order in which a view goes through it.
///
///     labels, looks -> extinction, colour, normal of each voxel (volume_terms.h)     once, and where labels
///     change
///         -> rows of blocks of eight voxels along one axis; empty blocks are not stored
///             -> lit blocks: extinction and light                                    for each direction of
///             view, those that are met (volume_simd.h)
///
/// A row never lies along the direction of view: rows along i serve the views along j and k, rows along j
/// those along i. A block is a cache line.
namespace palpate::internal::volume_picture {

/// Rows of blocks along an axis, for the whole grid.
class BlockRows {
 public:
  BlockRows() = default;
  /// @param along  the rows' axis: 0 or 1
  BlockRows(const GridGeometry& grid, int along);

  /// Puts a voxel block at its place, or takes it away where it is empty.
  /// @param i, j, k  its first voxel
  void put(int i, int j, int k, const VoxelBlock& block);
  /// @param into  away from the viewer, unit
  RowsView view(const Vector<Patient>& into, const VolumeLight& light) const;
  /// Its blocks, by their number; null where one is empty.
  struct Row {
    const std::uint64_t* mask;
    const std::uint32_t* first;
    const VoxelBlock* voxels;

    const VoxelBlock* operator[](int block) const {
      const std::uint32_t place = place_of(mask, first, block);
      return place != 0 ? voxels + place : nullptr;
    }
  };
  /// @param across  the voxel across the rows; @param k  the slice
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
  /// For one block more of a group that has `count`.
  void make_room(std::size_t group, int count);

  int blocks_ = 0, words_ = 0, groups_ = 0;  ///< of a row
  section::Bricks<std::uint32_t> first_;     ///< RowsView
  section::Bricks<std::uint8_t> room_;       ///< for so many blocks there is room where a group lies
  section::Bricks<std::uint64_t> mask_;
  section::Bricks<VoxelBlock> voxels_;
};

/// Where rays need not look.
class Leaps {
 public:
  Leaps() = default;
  explicit Leaps(const GridGeometry& grid);
  /// Looks at the voxels of a box, of rows along i.
  void find(const BlockRows& rows, const VoxelBox& box);
  /// @param x, y, z  the grid's axes that a view calls so
  CubesView view(int x, int y, int z) const;
  std::size_t bytes() const { return leap_.size() * (sizeof(leap_[0]) + sizeof(filled_[0])); }

 private:
  using Cubes = std::array<std::array<int, 2>, 3>;  ///< first ... last
  std::size_t index(int a, int b, int c) const {
    return static_cast<std::size_t>(a) +
           static_cast<std::size_t>(cubes_[0]) *
               (static_cast<std::size_t>(b) +
                static_cast<std::size_t>(cubes_[1]) * static_cast<std::size_t>(c));
  }
  /// Which cells of these cubes have something.
  void fill(const BlockRows& rows, const Cubes& cubes);
  /// Lowers leaps to what those of the cubes allow that were passed before.
  void pass(const Cubes& region, int step);

  std::array<int, 3> voxels_{}, cubes_{};
  section::Bricks<std::uint64_t> filled_;
  section::Bricks<std::uint8_t> leap_;
};

class Encoding {
 public:
  explicit Encoding(const GridGeometry& grid, std::span<const StructureLook> looks, ScanLook scan = {});
  /// Makes the blocks of all voxels whose look depends on labels in a box. Errors: kInterrupted.
  Result<void> encode(const palpate::Bricks<LabelId>& labels, const VoxelBox& box, int threads,
                      const Progress& progress);

  const GridGeometry& grid() const { return grid_; }
  /// @param axis  along which one looks
  const BlockRows& rows_for(int axis) const { return rows_[axis == 0 ? 1 : 0]; }
  const Leaps& leaps() const { return leaps_; }
  std::size_t bytes() const { return rows_[0].bytes() + rows_[1].bytes() + leaps_.bytes(); }

 private:
  class Tile;

  GridGeometry grid_;
  std::vector<StructureLook> looks_;
  ScanLook scan_;
  Eigen::Matrix3d to_patient_;                 ///< turns a gradient by voxels into one by mm
  std::array<std::vector<float>, 3> kernels_;  ///< of the smoothed opacity along i, j, k
  std::array<BlockRows, 2> rows_;
  Leaps leaps_;
  bool is_new_ = true;
};

}  // namespace palpate::internal::volume_picture
