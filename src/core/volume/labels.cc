#include <algorithm>

#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

namespace palpate {

bool GridGeometry::same_grid(const GridGeometry& other, double tolerance_voxels) const {
  if (dims != other.dims) return false;
  if (X_PatientVoxel().linear().determinant() == 0.0) return false;
  // the distance of two affine maps is largest at a corner
  const Transform<Voxel, Voxel> moved = X_PatientVoxel().inverse() * other.X_PatientVoxel();
  for (int corner = 0; corner < 8; ++corner) {
    const Point<Voxel> p((corner & 1) ? dims[0] - 1 : 0, (corner & 2) ? dims[1] - 1 : 0,
                         (corner & 4) ? dims[2] - 1 : 0);
    // negated, so that NaN yields false
    if (!((moved * p - p).norm() <= tolerance_voxels)) return false;
  }
  return true;
}

const Segment* LabelMap::find(LabelId id) const {
  const auto found = std::lower_bound(segments.begin(), segments.end(), id,
                                      [](const Segment& s, LabelId requested) { return s.id < requested; });
  return found != segments.end() && found->id == id ? &*found : nullptr;
}

const Segment* LabelMap::find(const std::string& name) const {
  const auto found =
      std::find_if(segments.begin(), segments.end(), [&](const Segment& s) { return s.name == name; });
  return found != segments.end() ? &*found : nullptr;
}

Volume<LabelId> LabelMap::flattened() const {
  Volume<LabelId> flat(geometry());
  for (std::size_t layer = 0; layer < layers.size(); ++layer) {
    // maps values to ids; a value without a segment maps to itself
    std::vector<LabelId> ids(65536);
    for (std::size_t value = 0; value < ids.size(); ++value) ids[value] = static_cast<LabelId>(value);
    for (const Segment& s : segments)
      if (s.layer == static_cast<int>(layer)) ids[s.value] = s.id;

    const std::vector<LabelId>& voxels = layers[layer].voxels();
    for (std::size_t n = 0; n < voxels.size(); ++n)
      if (voxels[n] != 0) flat.voxels()[n] = ids[voxels[n]];
  }
  return flat;
}

std::vector<int> empty_slices(const LabelMap& labels) {
  const GridGeometry& grid = labels.geometry();
  const std::size_t slice = static_cast<std::size_t>(grid.dims[0]) * static_cast<std::size_t>(grid.dims[1]);
  std::vector<int> empty;
  for (int k = 0; k < grid.dims[2]; ++k) {
    const bool any =
        std::any_of(labels.layers.begin(), labels.layers.end(), [&](const Volume<LabelId>& layer) {
          const LabelId* first = layer.voxels().data() + grid.offset(0, 0, k);
          return std::any_of(first, first + slice, [](LabelId value) { return value != 0; });
        });
    if (!any) empty.push_back(k);
  }
  return empty;
}

}  // namespace palpate
