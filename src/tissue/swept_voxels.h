#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "palpate/tissue/carving.h"

/// Which voxels a sweep can concern.
namespace palpate {

/// Those whose centres lie within so many mm of its axis, at least; none outside the grid.
inline VoxelBox voxels_around(const Sweep& sweep, double within_mm, const GridGeometry& grid) {
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  const Point<Voxel> from = X_VoxelPatient * sweep.from, to = X_VoxelPatient * sweep.to;
  VoxelBox box;
  for (std::size_t a = 0; a < 3; ++a) {
    const int axis = static_cast<int>(a);
    const double reach = within_mm / grid.spacing_mm[axis], last = grid.dims[a] - 1;
    const double low = std::clamp(std::ceil(std::min(from[axis], to[axis]) - reach), 0.0, last + 1);
    const double high = std::clamp(std::floor(std::max(from[axis], to[axis]) + reach), -1.0, last);
    box.first[a] = static_cast<int>(low);
    box.size[a] = std::max(0, static_cast<int>(high) - box.first[a] + 1);
  }
  return box;
}

/// By label, for all that there can be: what is not felt, or kept, is not taken away.
inline std::vector<bool> labels_that_are_cut(const Model& model) {
  std::vector<bool> is_cut(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  for (std::size_t label = 0; label < is_cut.size(); ++label) {
    const auto id = static_cast<LabelId>(label);
    is_cut[label] = model.is_felt(id) && model.tissue_of(id)->protection != Protection::kKeep;
  }
  return is_cut;
}

}  // namespace palpate
