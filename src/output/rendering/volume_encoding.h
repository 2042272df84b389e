#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/rendering/volume_renderer.h"
#include "rendering/block_rows.h"
#include "rendering/empty_space_map.h"

/// Encoding of a volume's visible voxels in the traversal order of a view.
///
///    labels, appearances -> extinction, colour, normal of each voxel (volume_terms.h)  once, and on changes
///        -> rows of blocks of eight voxels along one axis; empty blocks are not stored
///            -> lit blocks: extinction and radiance      per viewing direction, on demand (volume_simd.h)
///
/// Rows are never parallel to the viewing direction: rows along i serve views along j and k, rows along j
/// those along i. A block is a cache line.
namespace palpate::internal::volume_picture {

/// Blocks of voxels for both row directions, and the map of empty space, of one labelled volume and
/// appearance.
class VolumeEncoding {
 public:
  explicit VolumeEncoding(const GridGeometry& grid, std::span<const StructureAppearance> appearances,
                          ScanAppearance scan = {});
  /// Rebuilds the blocks of all voxels whose appearance depends on labels in a box. Errors: kInterrupted.
  Result<void> encode(const Bricks<LabelId>& labels, const VoxelBox& box, int threads,
                      const Progress& progress);

  const GridGeometry& grid() const { return grid_; }
  /// @param axis  principal axis of the view
  const BlockRows& rows_for(int axis) const { return rows_[axis == 0 ? 1 : 0]; }
  const EmptySpaceMap& skips() const { return skips_; }
  std::size_t bytes() const { return rows_[0].bytes() + rows_[1].bytes() + skips_.bytes(); }

 private:
  class Tile;
  struct TileGrid;
  struct PositionedBlock;

  TileGrid tiles_around(const VoxelBox& box, int workers) const;
  /// Voxels whose encoding changes with labels in a box: those within `reach`; all of the grid's region at
  /// first, and with a scan, as emptiness is not stored for voxels that show the scan only.
  VoxelBox affected_by(const VoxelBox& box, const std::array<int, 3>& reach, const TileGrid& grid) const;
  void store(const std::vector<PositionedBlock>& blocks);

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
