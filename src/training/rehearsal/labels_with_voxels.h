#pragma once

#include <limits>
#include <vector>

#include "palpate/contact/model.h"

namespace palpate {

/// Whether a label has a voxel in the model, for every possible LabelId.
inline std::vector<bool> labels_with_voxels(const Model& model) {
  std::vector<bool> has(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  model.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
    for (int n = 0; n < (piece.uniform ? 1 : piece.count); ++n) has[piece.voxels[n]] = true;
  });
  return has;
}

}  // namespace palpate
