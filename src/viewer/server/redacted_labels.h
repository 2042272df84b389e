#pragma once

#include <memory>
#include <vector>

#include "palpate/volume/bricks.h"

namespace palpate::server {

/// Labels in which some structures are replaced by what surrounds them (inpainting).
///
/// A straight line of hidden voxels that ends in the same structure at both ends is evidence that this
/// structure continues through it. Lines in 13 directions give each hidden voxel weighted votes, with more
/// weight for shorter lines. A connected component almost all of whose votes name one structure becomes that
/// structure as a whole; otherwise each voxel becomes the structure with most votes, and a voxel without
/// votes takes the label of its neighbours. Label 0 (air) is not counted: only a component that touches
/// nothing else becomes air.
///
/// The result depends on the grid of labels alone, in particular not on the order of the structures.
///
/// @param hidden  flag per label, for all 65 536
/// @returns `labels` itself if no voxel is hidden; bricks without hidden voxels are shared
std::shared_ptr<const Bricks<LabelId>> redacted_labels(std::shared_ptr<const Bricks<LabelId>> labels,
                                                       const std::vector<bool>& hidden);

}  // namespace palpate::server
