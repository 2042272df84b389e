#include "palpate/tissue/elastic_layout.h"

#include <algorithm>
#include <cmath>

#include "palpate/geometry/decompositions.h"

namespace palpate {

CellBox CellBox::joined(const CellBox& other) const {
  if (empty()) return other;
  if (other.empty()) return *this;
  CellBox both = *this;
  for (int axis = 0; axis < 3; ++axis) {
    both.low[axis] = std::min(low[axis], other.low[axis]);
    both.high[axis] = std::max(high[axis], other.high[axis]);
  }
  return both;
}

CellBox CellBox::grown(int by) const {
  CellBox box = *this;
  for (int axis = 0; axis < 3; ++axis) {
    box.low[axis] -= by;
    box.high[axis] += by;
  }
  return box;
}

CellBox CellBox::clipped(const std::array<int, 3>& cells) const {
  CellBox box = *this;
  for (int axis = 0; axis < 3; ++axis) {
    box.low[axis] = std::max(low[axis], 0);
    box.high[axis] = std::min(high[axis], cells[axis]);
  }
  return box;
}

ElasticBox elastic_box_of(const GridGeometry& grid, const VoxelBox& region, double cell_mm) {
  const SingularVectors svd = singular_vectors(grid.direction);
  ElasticBox box;
  box.axes = svd.u * svd.v.transpose();
  box.cell_mm = cell_mm;
  Point<Voxel> corner;
  for (int a = 0; a < 3; ++a) {
    corner[a] = region.first[a] - 0.5;
    // a last sliver that contains no voxel centre gets no cell
    if (cell_mm > 0)
      box.cells[a] = static_cast<int>(std::ceil(region.size[a] * grid.spacing_mm[a] / cell_mm - 1e-6));
  }
  box.corner = grid.X_PatientVoxel() * corner;
  return box;
}

}  // namespace palpate
