#include <algorithm>

#include "palpate/direct/force_field.h"
#include "palpate/scene/scene.h"
#include "palpate/surfaces/ramps.h"
#include "scene/keys.h"

namespace palpate {

const GridGeometry& field_grid(const GridGeometry* labels, const GridGeometry* scan) {
  PALPATE_CHECK(labels || scan);
  if (!labels || !scan) return labels ? *labels : *scan;
  return labels->voxel_volume_mm3() <= scan->voxel_volume_mm3() ? *labels : *scan;
}

double largest_spacing_mm(const GridGeometry* labels, const GridGeometry* scan) {
  const double field_mm = field_grid(labels, scan).spacing_mm.maxCoeff();
  return labels ? std::max(field_mm, labels->spacing_mm.maxCoeff()) : field_mm;
}

double max_tissue_force_N(const TissueSettings& tissue, double sigma_mm, const GridGeometry& grid) {
  return tissue.stiffness_N_per_mm * ramp_mm(sigma_mm, grid);
}

}  // namespace palpate
