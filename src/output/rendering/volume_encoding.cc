#include "rendering/volume_encoding.h"

#include <algorithm>
#include <atomic>
#include <limits>
#include <mutex>

#include "palpate/base/for_each_index.h"
#include "palpate/volume/gaussian_kernel.h"
#include "rendering/volume_encoding_tile.h"
#include "rendering/volume_terms.h"

namespace palpate::internal::volume_picture {

namespace {

constexpr int kTileSide = 64;
/// Usual number of blocks per tile, to avoid reallocation while they are collected.
constexpr std::size_t kUsualBlocks = 16384;

}  // namespace

struct VolumeEncoding::PositionedBlock {
  int rows, i, j, k;
  VoxelBlock block;
};

/// Partition of the region to encode into tiles of whole blocks along i and along j.
struct VolumeEncoding::TileGrid {
  std::array<int, 3> from{}, to{};  ///< First voxel of the region, and the one after its last
  std::array<int, 3> tiles{};       ///< Number of tiles along each axis
  int thickness = kTileSide;        ///< Slices of a tile

  int count() const { return tiles[0] * tiles[1] * tiles[2]; }
  VoxelBox tile(int n) const {
    const std::array<int, 3> tile{n % tiles[0], n / tiles[0] % tiles[1], n / tiles[0] / tiles[1]};
    VoxelBox box;
    for (std::size_t a = 0; a < 3; ++a) {
      const int side = a == 2 ? thickness : kTileSide;
      box.first[a] = from[a] + tile[a] * side;
      box.size[a] = std::min(side, to[a] - box.first[a]);
    }
    return box;
  }
};

VolumeEncoding::VolumeEncoding(const GridGeometry& grid, std::span<const StructureAppearance> appearances,
                               ScanAppearance scan)
    : grid_(grid),
      appearances_(appearances.begin(), appearances.end()),
      scan_(std::move(scan)),
      to_patient_(grid.X_PatientVoxel().linear().inverse().transpose()),
      rows_{BlockRows(grid, 0), BlockRows(grid, 1)},
      skips_(grid) {
  const auto sigma = sigma_in_voxels(grid, normal_sigma_mm(grid));
  for (std::size_t a = 0; a < 3; ++a) kernels_[a] = smoothing_kernel(sigma ? (*sigma)[a] : 0);
}

VolumeEncoding::TileGrid VolumeEncoding::tiles_around(const VoxelBox& box, int workers) const {
  const std::array<int, 3> margin = Tile::margins(*this);
  TileGrid grid;
  for (std::size_t a = 0; a < 3; ++a) {
    grid.from[a] = std::max(0, box.first[a] - margin[a]);
    if (a < 2) grid.from[a] = grid.from[a] / kBlock * kBlock;
    grid.to[a] = std::min(grid_.dims[a], box.first[a] + box.size[a] + margin[a]);
    if (a < 2) grid.to[a] = std::min(grid_.dims[a], blocks_along(grid.to[a]) * kBlock);
    grid.tiles[a] = std::max(0, grid.to[a] - grid.from[a] + kTileSide - 1) / kTileSide;
  }
  // a region too small for one tile per worker is cut into thinner tiles
  const int columns = grid.tiles[0] * grid.tiles[1];
  if (columns > 0 && columns * grid.tiles[2] < workers) {
    const int slices = grid.to[2] - grid.from[2], layers = (workers + columns - 1) / columns;
    grid.thickness = std::clamp((slices + layers - 1) / layers, kBlock, kTileSide);
    grid.tiles[2] = (slices + grid.thickness - 1) / grid.thickness;
  }
  return grid;
}

VoxelBox VolumeEncoding::affected_by(const VoxelBox& box, const std::array<int, 3>& reach,
                                     const TileGrid& grid) const {
  VoxelBox affected;
  const bool is_all = is_new_ || scan_.scan != nullptr;
  for (std::size_t a = 0; a < 3; ++a) {
    affected.first[a] = is_all ? grid.from[a] : std::max(0, box.first[a] - reach[a]);
    const int end = is_all ? grid.to[a] : std::min(grid_.dims[a], box.first[a] + box.size[a] + reach[a]);
    affected.size[a] = end - affected.first[a];
  }
  return affected;
}

void VolumeEncoding::store(const std::vector<PositionedBlock>& blocks) {
  for (const PositionedBlock& one : blocks)
    rows_[static_cast<std::size_t>(one.rows)].put(one.i, one.j, one.k, one.block);
}

Result<void> VolumeEncoding::encode(const Bricks<LabelId>& labels, const VoxelBox& box, int threads,
                                    const Progress& progress) {
  const int workers = worker_count(threads, std::numeric_limits<int>::max());
  const TileGrid grid = tiles_around(box, workers);
  // a voxel's appearance depends on the 27 around it, its normal on all within the reach of the smoothing
  const VoxelBox changed = affected_by(box, {1, 1, 1}, grid),
                 renormalised = affected_by(box, Tile::margins(*this), grid);
  const int count = grid.count();
  std::mutex putting;
  // data that other workers read are modified later
  std::vector<std::vector<PositionedBlock>> later(is_new_ ? 0 : static_cast<std::size_t>(count));
  std::atomic<int> done{0};
  const bool whole = for_each_index(count, std::min(workers, count), [&](int worker, int n) {
    if (progress.stopped()) return false;
    std::vector<PositionedBlock> made;
    made.reserve(kUsualBlocks);
    Tile(*this, labels, grid.tile(n), changed, renormalised)
        .for_each_block([&](int rows, int i, int j, int k, const VoxelBlock& block) {
          // initially all blocks are empty
          const bool is_empty = std::all_of(std::begin(block.extinction), std::end(block.extinction),
                                            [](auto e) { return e == 0; });
          if (!is_new_ || !is_empty) made.push_back({rows, i, j, k, block});
        });
    if (is_new_) {
      const std::lock_guard lock(putting);
      store(made);
    } else {
      later[static_cast<std::size_t>(n)] = std::move(made);
    }
    if (worker == 0)
      progress.report("volume", static_cast<double>(++done) / count);
    else
      ++done;
    return true;
  });
  if (!whole) return Progress::interrupted();
  for_each_index(2, std::min(workers, 2), [&](int, int rows) {
    for (const std::vector<PositionedBlock>& made : later)
      for (const PositionedBlock& one : made)
        if (one.rows == rows) rows_[static_cast<std::size_t>(rows)].put(one.i, one.j, one.k, one.block);
    // skips use the rows along i
    if (rows == 0) skips_.update(rows_[0], changed);
    return true;
  });
  is_new_ = false;
  return {};
}

}  // namespace palpate::internal::volume_picture
