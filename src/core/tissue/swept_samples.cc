#include "palpate/tissue/swept_samples.h"

#include "tissue/swept_voxels.h"

namespace palpate {
namespace {

constexpr std::uint64_t kAll = ~std::uint64_t{0};

std::size_t blocks_along(int voxels, int edge) {
  return static_cast<std::size_t>((voxels + edge - 1) / edge);
}

}  // namespace

Point<Voxel> SweptSamples::sample_point(int i, int j, int k, int n) {
  const auto along = [](int voxel, int index) { return voxel + (index + 0.5) / kAlong - 0.5; };
  return {along(i, n % kAlong), along(j, n / kAlong % kAlong), along(k, n / (kAlong * kAlong))};
}

std::array<int, 3> SweptSamples::voxel_at(std::size_t block, std::size_t n) const {
  const std::size_t columns = blocks_along(dims_[0], kEdge), rows = blocks_along(dims_[1], kEdge);
  const auto voxel = [](std::size_t of_block, std::size_t in_block) {
    return static_cast<int>(of_block * kEdge + in_block % kEdge);
  };
  return {voxel(block % columns, n), voxel(block / columns % rows, n / kEdge),
          voxel(block / (columns * rows), n / (kEdge * kEdge))};
}

std::size_t SweptSamples::block_of(int i, int j, int k) const {
  const std::size_t columns = blocks_along(dims_[0], kEdge), rows = blocks_along(dims_[1], kEdge);
  return static_cast<std::size_t>(i / kEdge) +
         columns * (static_cast<std::size_t>(j / kEdge) + rows * static_cast<std::size_t>(k / kEdge));
}

std::size_t SweptSamples::index_in_block(int i, int j, int k) {
  return static_cast<std::size_t>((k % kEdge * kEdge + j % kEdge) * kEdge + i % kEdge);
}

std::uint64_t SweptSamples::at(int i, int j, int k) const {
  if (i < 0 || j < 0 || k < 0 || i >= dims_[0] || j >= dims_[1] || k >= dims_[2]) return 0;
  const auto found = blocks_.find(block_of(i, j, k));
  return found == blocks_.end() ? 0 : (*found->second)[index_in_block(i, j, k)];
}

std::uint64_t* SweptSamples::samples_of(int i, int j, int k) {
  std::shared_ptr<Block>& block = blocks_[block_of(i, j, k)];
  if (block == nullptr)
    block = std::make_shared<Block>(Block{});
  else if (block.use_count() > 1)
    block = std::make_shared<Block>(*block);
  return &(*block)[index_in_block(i, j, k)];
}

std::vector<SweptSamples::VoxelSamples> SweptSamples::add(const Sweep& sweep, const Bricks<LabelId>& labels,
                                                          const std::vector<bool>& is_cut) {
  const GridGeometry& grid = labels.geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  const double half_diagonal_mm = 0.5 * grid.spacing_mm.norm();
  const VoxelBox box = voxels_around(sweep, sweep.max_radius_mm() + half_diagonal_mm, grid);
  const SweptShape shape(sweep);
  std::vector<VoxelSamples> added;
  for (int k = box.first[2]; k < box.first[2] + box.size[2]; ++k)
    for (int j = box.first[1]; j < box.first[1] + box.size[1]; ++j)
      for (int i = box.first[0]; i < box.first[0] + box.size[0]; ++i) {
        if (!is_cut[labels.at(i, j, k)]) continue;
        const double depth_mm = shape.depth_mm(X_PatientVoxel * Point<Voxel>(i, j, k));
        if (depth_mm <= -half_diagonal_mm) continue;
        std::uint64_t& swept = *samples_of(i, j, k);
        if (swept == kAll) continue;
        std::uint64_t now = ~swept;
        if (depth_mm < half_diagonal_mm)
          for (int n = 0; n < kSamples; ++n) {
            const std::uint64_t bit = std::uint64_t{1} << n;
            if ((now & bit) != 0 && !(shape.depth_mm(X_PatientVoxel * sample_point(i, j, k, n)) > 0))
              now &= ~bit;
          }
        if (now == 0) continue;
        swept |= now;
        added.push_back({i, j, k, now});
      }
  return added;
}

}  // namespace palpate
