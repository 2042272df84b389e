#pragma once

#include <cstdint>

#include "surfaces/surface_block.h"

namespace palpate::internal {

/// A run of voxels i = first ... last of a row that belong to a structure.
struct LabelRun {
  int first, last, j, k;
  std::uint32_t component;
};

/// A connected component.
struct Component {
  std::size_t voxels = 0;
  Span3 span;
  Eigen::Vector3d index_sum = Eigen::Vector3d::Zero();
};

/// Connected components of one label. Voxels that share a face, an edge or a corner (26-neighbourhood) are
/// connected, because the surface has no gap between them. Ordered by their first voxels.
struct Components {
  std::vector<LabelRun> runs;  ///< In memory order
  std::vector<Component> all;
};
/// @param within  part of the grid that contains the label
Components find_components(const Bricks<LabelId>& labels, LabelId label, const Span3& within);

/// Bounding box of every label present, by label; empty for the others.
std::vector<Span3> label_spans(const Bricks<LabelId>& labels);

}  // namespace palpate::internal
