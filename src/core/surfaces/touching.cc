#include "surfaces/touching.h"

#include <algorithm>
#include <array>

namespace palpate::internal {

Result<Touching> find_touching(const Bricks<LabelId>& labels, const std::vector<int>& index,
                               std::size_t structures, Adjacency adjacency, int threads,
                               const Progress& progress, const ProgressSpan& stage) {
  const GridGeometry& grid = labels.geometry();
  const int workers = worker_count(threads, grid.dims[2]);
  std::vector<Touching> found(static_cast<std::size_t>(workers), Touching(structures));
  // half of a voxel's neighbours; the other half is covered symmetrically
  struct Neighbour {
    int i, j, k;
  };
  constexpr std::array<Neighbour, 13> kNeighbours{{{1, 0, 0},
                                                   {0, 1, 0},
                                                   {0, 0, 1},
                                                   {1, 1, 0},
                                                   {-1, 1, 0},
                                                   {1, 0, 1},
                                                   {-1, 0, 1},
                                                   {0, 1, 1},
                                                   {0, -1, 1},
                                                   {1, 1, 1},
                                                   {-1, 1, 1},
                                                   {1, -1, 1},
                                                   {-1, -1, 1}}};
  const std::size_t neighbours = adjacency == Adjacency::kFace ? 3 : kNeighbours.size();
  const auto done = for_each_slice(grid.dims[2], workers, progress, stage, [&](int worker, int k) {
    Touching& mine = found[static_cast<std::size_t>(worker)];
    const auto visit_piece = [&](const RowPiece<LabelId>& piece) {
      if (piece.uniform) return;
      for (std::size_t n = 0; n < neighbours; ++n) {
        const Neighbour& to = kNeighbours[n];
        const LabelId* const a = piece.voxels;
        const LabelId* const b = a + (to.i + to.j * BrickLayout::kRow + to.k * BrickLayout::kSlice);
        // voxels outside the volume belong to no structure
        for (int i = 0; i < piece.count; ++i)
          if (a[i] != b[i]) mine.add(index[a[i]], index[b[i]]);
      }
    };
    for (int j = 0; j < grid.dims[1]; ++j) labels.for_each_piece(j, k, visit_piece);
  });
  if (!done) return done.error();
  for (std::size_t w = 1; w < found.size(); ++w) found[0].add(found[w]);
  return found[0];
}

}  // namespace palpate::internal
