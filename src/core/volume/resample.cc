#include <algorithm>
#include <cmath>

#include "palpate/volume/label_map.h"
#include "palpate/volume/resample.h"
#include "palpate/volume/volume.h"

namespace palpate {
namespace {

// A voxel covers half a voxel around its centre; the tolerance keeps rounding of the transform from deciding
// whether a point on its face is inside.
constexpr double kReach = 0.5 + 1e-6;

Error no_overlap() {
  return {ErrorKind::kBadInput, "the two volumes do not overlap in the patient", "",
          "check that both come from the same patient and study, and that neither has lost its geometry"};
}

/// Calls take(offset in `grid`, position in `source`) for each voxel of `grid` whose centre lies within
/// `source`, in memory order; returns whether there was one.
template <class Take>
bool for_each_covered(const GridGeometry& source, const GridGeometry& grid, const Take& visit) {
  const auto X_SourceGrid = source.X_PatientVoxel().inverse() * grid.X_PatientVoxel();
  bool any = false;
  std::size_t offset = 0;
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i, ++offset) {
        const Point<Voxel> p = X_SourceGrid * Point<Voxel>(i, j, k);
        bool inside = true;
        for (int a = 0; a < 3; ++a)
          inside &= p[a] >= -kReach && p[a] <= source.dims[static_cast<std::size_t>(a)] - 1 + kReach;
        if (!inside) continue;
        any = true;
        visit(offset, p);
      }
    }
  }
  return any;
}

// lower and upper neighbour of a coordinate along one axis and the weight of the upper one, clamped to the
// grid
struct Neighbours {
  int low, high;
  double weight;
};

Neighbours neighbours(double coordinate, int count) {
  const double x = std::min(std::max(coordinate, 0.0), static_cast<double>(count - 1));
  const int low = static_cast<int>(x);
  return {low, std::min(low + 1, count - 1), x - low};
}

double interpolate(const Volume<float>& scan, const Point<Voxel>& p) {
  const auto& dims = scan.geometry().dims;
  const Neighbours x = neighbours(p.x(), dims[0]), y = neighbours(p.y(), dims[1]),
                   z = neighbours(p.z(), dims[2]);
  const auto along_x = [&](int j, int k) {
    return (1 - x.weight) * scan.at(x.low, j, k) + x.weight * scan.at(x.high, j, k);
  };
  const auto along_y = [&](int k) {
    return (1 - y.weight) * along_x(y.low, k) + y.weight * along_x(y.high, k);
  };
  return (1 - z.weight) * along_y(z.low) + z.weight * along_y(z.high);
}

// nearest index, halves rounded up, clamped to the grid
int nearest(double coordinate, int count) {
  return std::min(std::max(static_cast<int>(std::floor(coordinate + 0.5)), 0), count - 1);
}

}  // namespace

Result<Volume<float>> resample_linear(const Volume<float>& scan, const GridGeometry& grid, float outside) {
  Volume<float> result(grid, outside);
  const bool any = for_each_covered(scan.geometry(), grid, [&](std::size_t offset, const Point<Voxel>& p) {
    result.voxels()[offset] = static_cast<float>(interpolate(scan, p));
  });
  if (!any) return no_overlap();
  return result;
}

Result<LabelMap> resample_nearest(const LabelMap& labels, const GridGeometry& grid) {
  const GridGeometry& source = labels.geometry();
  LabelMap result;
  result.segments = labels.segments;
  result.layers.assign(labels.layers.size(), Volume<LabelId>(grid));
  const bool any = for_each_covered(source, grid, [&](std::size_t offset, const Point<Voxel>& p) {
    const std::size_t from = source.offset(nearest(p.x(), source.dims[0]), nearest(p.y(), source.dims[1]),
                                           nearest(p.z(), source.dims[2]));
    for (std::size_t layer = 0; layer < labels.layers.size(); ++layer)
      result.layers[layer].voxels()[offset] = labels.layers[layer].voxels()[from];
  });
  if (!any) return no_overlap();
  return result;
}

}  // namespace palpate
