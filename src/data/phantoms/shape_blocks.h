#pragma once

#include <array>
#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/slices.h"
#include "phantoms/shape_node.h"

/// Hierarchical voxelisation of shapes. The grid is divided into blocks; for each block the shape is reduced
/// to the operands that matter within its bounding sphere. Most blocks are then decided as a whole, the
/// others are halved along each axis and evaluated again, down to a few voxels. Top-level blocks run in
/// parallel and write only their own voxels, so the result is independent of the number of threads.
namespace palpate {

/// Voxels begin ... end-1 of a grid along each axis.
struct VoxelBlock {
  std::array<int, 3> begin, end;

  /// Calls visit(i, j, k) for each voxel, i fastest.
  template <class Visit>
  void for_each_voxel(const Visit& visit) const {
    for (int k = begin[2]; k < end[2]; ++k) {
      for (int j = begin[1]; j < end[1]; ++j) {
        for (int i = begin[0]; i < end[0]; ++i) visit(i, j, k);
      }
    }
  }
};

/// Half of the longest diagonal of a box of voxels; mm.
inline double half_diagonal_mm(const GridGeometry& grid, const Eigen::Vector3d& voxels) {
  const Eigen::Matrix3d edges = grid.X_PatientVoxel().linear() * voxels.asDiagonal();
  double longest = 0;
  for (const int sy : {-1, 1}) {
    for (const int sz : {-1, 1}) longest = std::max(longest, (edges * Eigen::Vector3d(1, sy, sz)).norm());
  }
  return 0.5 * longest;
}

/// Bounding sphere of a block's voxels, including their full extent.
inline Ball ball_around(const GridGeometry& grid, const VoxelBlock& block) {
  const Eigen::Vector3d begin(block.begin[0], block.begin[1], block.begin[2]);
  const Eigen::Vector3d end(block.end[0], block.end[1], block.end[2]);
  const Eigen::Vector3d centre = 0.5 * (begin + end) - Eigen::Vector3d::Constant(0.5);
  return {(grid.X_PatientVoxel() * Point<Voxel>(centre)).eigen(), half_diagonal_mm(grid, end - begin)};
}

inline constexpr int kTopBlock = 32;  ///< Edge length of the blocks processed in parallel; voxels.
inline constexpr int kLeafBlock = 2;  ///< Edge length of the smallest blocks; voxels.

/// Visits a block and its sub-blocks. `narrow(state, block, ball)` returns the state reduced to the block, or
/// nullopt if the block is finished; `leaf(state, block)` processes the voxels of a smallest block.
template <class State, class Narrow, class Leaf>
void descend(const GridGeometry& grid, const VoxelBlock& block, const State& state, const Narrow& narrow,
             const Leaf& leaf) {
  const std::optional<State> here = narrow(state, block, ball_around(grid, block));
  if (!here) return;
  std::array<std::vector<int>, 3> cuts;
  bool small = true;
  for (std::size_t a = 0; a < 3; ++a) {
    const int length = block.end[a] - block.begin[a];
    cuts[a] = {block.begin[a], block.end[a]};
    if (length <= kLeafBlock) continue;
    cuts[a].insert(cuts[a].begin() + 1, block.begin[a] + length / 2);
    small = false;
  }
  if (small) return leaf(*here, block);
  for (std::size_t k = 1; k < cuts[2].size(); ++k) {
    for (std::size_t j = 1; j < cuts[1].size(); ++j) {
      for (std::size_t i = 1; i < cuts[0].size(); ++i) {
        const VoxelBlock part{{cuts[0][i - 1], cuts[1][j - 1], cuts[2][k - 1]},
                              {cuts[0][i], cuts[1][j], cuts[2][k]}};
        descend(grid, part, *here, narrow, leaf);
      }
    }
  }
}

inline std::vector<VoxelBlock> top_blocks(const GridGeometry& grid) {
  std::vector<VoxelBlock> blocks;
  for (int k = 0; k < grid.dims[2]; k += kTopBlock) {
    for (int j = 0; j < grid.dims[1]; j += kTopBlock) {
      for (int i = 0; i < grid.dims[0]; i += kTopBlock) {
        blocks.push_back({{i, j, k},
                          {std::min(i + kTopBlock, grid.dims[0]), std::min(j + kTopBlock, grid.dims[1]),
                           std::min(k + kTopBlock, grid.dims[2])}});
      }
    }
  }
  return blocks;
}

/// Visits a whole grid; false if interrupted.
template <class State, class Narrow, class Leaf>
bool visit_grid(const GridGeometry& grid, const State& state, std::string_view stage,
                const Progress& progress, const Narrow& narrow, const Leaf& leaf) {
  const std::vector<VoxelBlock> blocks = top_blocks(grid);
  const auto count = static_cast<int>(blocks.size());
  return internal::for_each_slice(
             count, worker_count(0, count), progress, {stage},
             [&](int, int b) { descend(grid, blocks[static_cast<std::size_t>(b)], state, narrow, leaf); })
      .ok();
}

}  // namespace palpate
