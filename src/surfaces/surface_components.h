#pragma once

#include <cstdint>

#include "surfaces/surface_block.h"

namespace palpate::internal {

/// Voxels i = first ... last of a row that belong to a structure.
struct LabelRun {
  int first, last, j, k;
  std::uint32_t component;
};

struct Component {
  std::size_t voxels = 0;
  Span3 span;
  Eigen::Vector3d index_sum = Eigen::Vector3d::Zero();
};

/// The connected components of one label: voxels are connected where they share a face, an edge or a corner
/// (26 neighbours), as the surface between them has no gap then. In the order of their first voxels.
struct Components {
  std::vector<LabelRun> runs;  ///< in memory's order
  std::vector<Component> all;
};
/// @param within  part of the grid that holds the label
Components find_components(const Bricks<LabelId>& labels, LabelId label, const Span3& within);

/// The box of every label present, by label; empty spans for the others.
std::vector<Span3> label_spans(const Bricks<LabelId>& labels);

}  // namespace palpate::internal
