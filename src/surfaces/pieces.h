#pragma once

#include <algorithm>
#include <vector>

#include "palpate/base/for_each_index.h"
#include "surfaces/surface_block.h"

namespace palpate::internal {

/// What threads work on: parts of a box, one at a time each.
struct Pieces {
  std::vector<Span3> all;  ///< in memory's order of their first voxels
  int workers = 1;
};

/// Cuts a box into slabs of so many slices; and those into strips of rows where one, with all that is seen
/// around it, takes more than a thread should have. Where the strips cannot be that narrow fewer threads
/// work.
/// @param margin   voxels that are seen around a piece
/// @param threads  0: as many as the machine has
inline Pieces cut_into_pieces(const Span3& box, int slices, const Index3& margin, int threads) {
  Pieces pieces;
  if (box.empty()) return pieces;
  // what filters hold of a voxel, four numbers of 4 bytes; margins of strips that are narrower cost too much
  constexpr double kVoxel_bytes = 16, kPiece_bytes = 768 << 20, kAll_bytes = 2048.0 * (1 << 20);
  constexpr int kLeastRows = 64;
  const double row_bytes =
      kVoxel_bytes * (std::min(slices, box.size(2)) + 2.0 * margin[2]) * (box.size(0) + 2.0 * margin[0]);
  const auto most = static_cast<int>(std::min(1e6, kPiece_bytes / row_bytes)) - 2 * margin[1];
  const int strips = (box.size(1) + std::max(kLeastRows, most) - 1) / std::max(kLeastRows, most);
  const int rows = (box.size(1) + strips - 1) / strips;
  for (int k = box.low[2]; k < box.high[2]; k += slices) {
    for (int j = box.low[1]; j < box.high[1]; j += rows) {
      Span3& piece = pieces.all.emplace_back(box);
      piece.low[1] = j;
      piece.high[1] = std::min(box.high[1], j + rows);
      piece.low[2] = k;
      piece.high[2] = std::min(box.high[2], k + slices);
    }
  }
  const auto fit = static_cast<int>(std::min(1e6, kAll_bytes / (row_bytes * (rows + 2.0 * margin[1]))));
  pieces.workers = std::min(worker_count(threads, static_cast<int>(pieces.all.size())), std::max(2, fit));
  return pieces;
}

}  // namespace palpate::internal
