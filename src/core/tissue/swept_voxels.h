#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "palpate/tissue/carving.h"

/// Voxels that a sweep can affect.
namespace palpate {

/// Bounding box of the centres of a sweep's balls, in voxel indices.
struct SweepCentreBounds {
  Eigen::Array3d least, greatest;
};
inline SweepCentreBounds centre_bounds(const Sweep& sweep, const Transform<Voxel, Patient>& X_VoxelPatient) {
  const Eigen::Array3d from = (X_VoxelPatient * sweep.from).eigen().array();
  const Eigen::Array3d to = (X_VoxelPatient * sweep.to).eigen().array();
  SweepCentreBounds middles{from.min(to), from.max(to)};
  if (sweep.is_of_ball()) return middles;
  for (const Point<Patient>& begin : {sweep.from, sweep.to}) {
    const Eigen::Array3d end = (X_VoxelPatient * (begin + sweep.axis_mm)).eigen().array();
    middles = {middles.least.min(end), middles.greatest.max(end)};
  }
  return middles;
}

/// Calls run(centre, radius) for balls that cover a sweep, at most `separation_mm` apart.
template <class F>
void for_balls_of(const Sweep& sweep, double separation_mm, const F& run) {
  const Vector<Patient> displacement = sweep.to - sweep.from;
  const int steps = 1 + static_cast<int>(displacement.norm() / separation_mm);
  const int along = sweep.is_of_ball() ? 0 : 1 + static_cast<int>(sweep.axis_mm.norm() / separation_mm);
  for (int m = 0; m <= along; ++m) {
    const double part = along > 0 ? static_cast<double>(m) / along : 0;
    const double wider_mm = along > 0 ? (sweep.end_radius_mm - sweep.radius_mm) * part : 0;
    for (int n = 0; n <= steps; ++n) {
      const Point<Patient> at = sweep.from + displacement * (static_cast<double>(n) / steps);
      run(at + sweep.axis_mm * part, sweep.radius_mm + wider_mm);
    }
  }
}

/// Voxels of the grid whose centres may lie within `within_mm` of the centres of the sweep's balls.
inline VoxelBox voxels_around(const Sweep& sweep, double within_mm, const GridGeometry& grid) {
  const auto [least, greatest] = centre_bounds(sweep, grid.X_PatientVoxel().inverse());
  VoxelBox box;
  for (std::size_t a = 0; a < 3; ++a) {
    const int axis = static_cast<int>(a);
    const double reach = within_mm / grid.spacing_mm[axis], last = grid.dims[a] - 1;
    const double low = std::clamp(std::ceil(least[axis] - reach), 0.0, last + 1);
    const double high = std::clamp(std::floor(greatest[axis] + reach), -1.0, last);
    box.first[a] = static_cast<int>(low);
    box.size[a] = std::max(0, static_cast<int>(high) - box.first[a] + 1);
  }
  return box;
}

/// For each possible label, whether burrs cut it: it is touchable and not protected.
inline std::vector<bool> cuttable_labels(const Model& model) {
  std::vector<bool> is_cut(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  for (std::size_t label = 0; label < is_cut.size(); ++label) {
    const auto id = static_cast<LabelId>(label);
    is_cut[label] = model.is_touchable(id) && model.tissue_of(id)->protection != Protection::kBlock;
  }
  return is_cut;
}

}  // namespace palpate
