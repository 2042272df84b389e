#pragma once

#include <algorithm>
#include <vector>

#include "palpate/base/for_each_index.h"
#include "surfaces/surface_block.h"

namespace palpate::internal {

/// Margins around a piece of a box that are needed to compute it.
struct PieceMargins {
  Index3 filtered{0, 0, 0};  ///< Voxels computed additionally for a filter of the piece
  Index3 read{0, 0, 0};      ///< Additional voxels around these that are read
};

/// Number of slices per piece: limited by memory, and large enough that margins do not dominate the cost.
inline int slices_of_piece(const PieceMargins& margins) {
  return std::clamp(3 * margins.filtered[2] / 2, 24, 64);
}

/// Parts of a box that threads process one at a time.
struct Pieces {
  std::vector<Span3> all;  ///< In memory order of their first voxels
  int workers = 1;
};

/// Cuts a box into slabs, and slabs into strips of rows if one exceeds a thread's share of memory. If strips
/// cannot be narrow enough because of their margins, fewer threads are used.
/// @param threads  0: one per processor
inline Pieces cut_into_pieces(const Span3& box, const PieceMargins& margins, int threads) {
  Pieces pieces;
  if (box.empty()) return pieces;
  constexpr double kPiece_bytes = 1 << 30, kAll_bytes = 2.0 * (1 << 30);
  constexpr int kMinRows = 64;
  // bytes per voxel: 1 for the source, 4 for data filtered along k, 16 for filtered data
  const int slices = std::min(slices_of_piece(margins), box.size(2));
  const auto with = [](int voxels, int margin) { return voxels + 2.0 * margin; };
  const Index3& f = margins.filtered;
  const Index3 s{f[0] + margins.read[0], f[1] + margins.read[1], f[2] + margins.read[2]};
  const double border_bytes = with(box.size(0), s[0]) * (with(slices, s[2]) + 4 * with(slices, f[2]));
  const double filtered_bytes = 16 * with(box.size(0), f[0]) * with(slices, f[2]);
  const auto bytes = [&](int rows) {
    return border_bytes * with(rows, s[1]) + filtered_bytes * with(rows, f[1]);
  };
  const double largest = (kPiece_bytes - bytes(0)) / (border_bytes + filtered_bytes);
  const int at_most = std::max(kMinRows, static_cast<int>(std::min(1e6, largest)));
  const int strips = (box.size(1) + at_most - 1) / at_most, rows = (box.size(1) + strips - 1) / strips;
  for (int k = box.low[2]; k < box.high[2]; k += slices) {
    for (int j = box.low[1]; j < box.high[1]; j += rows) {
      Span3& piece = pieces.all.emplace_back(box);
      piece.low[1] = j;
      piece.high[1] = std::min(box.high[1], j + rows);
      piece.low[2] = k;
      piece.high[2] = std::min(box.high[2], k + slices);
    }
  }
  const auto fit = static_cast<int>(std::min(1e6, kAll_bytes / bytes(rows)));
  pieces.workers = std::min(worker_count(threads, static_cast<int>(pieces.all.size())), std::max(2, fit));
  return pieces;
}

/// Number of slices to compute before they are put in bricks: some pieces per thread.
inline int slices_at_a_time(const Span3& box, const PieceMargins& margins, int threads) {
  return worker_count(threads, box.size(2)) * std::max(48, slices_of_piece(margins));
}

}  // namespace palpate::internal
