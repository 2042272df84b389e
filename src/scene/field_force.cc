#include <algorithm>

#include "palpate/ramps.h"
#include "palpate/scene.h"
#include "scene/keys.h"

namespace palpate {

const GridGeometry& field_grid(const GridGeometry* labels, const GridGeometry* scan) {
  PALPATE_CHECK(labels || scan);
  if (!labels || !scan) return labels ? *labels : *scan;
  return labels->voxel_volume_mm3() <= scan->voxel_volume_mm3() ? *labels : *scan;
}

double widest_voxel_mm(const GridGeometry* labels, const GridGeometry* scan) {
  const double field_mm = field_grid(labels, scan).spacing_mm.maxCoeff();
  return labels ? std::max(field_mm, labels->spacing_mm.maxCoeff()) : field_mm;
}

Result<double> ramp_width_mm(const PreparationSettings& preparation, const GridGeometry& grid) {
  const double widest_mm = grid.spacing_mm.maxCoeff();
  const double width_mm = preparation.ramp_width_mm.value_or(std::max(kUsualRampWidth_mm, 2 * widest_mm));
  // rounding of a direction matrix is no reason
  if (width_mm >= 2 * widest_mm * (1 - 1e-6) && width_mm <= kMostRampWidth_mm) return width_mm;
  const std::string two_text = number_text(2 * widest_mm);
  return Error{ErrorKind::kBadInput,
               "a ramp of " + number_text(width_mm) + " mm on voxels that are up to " +
                   number_text(widest_mm) + " mm wide",
               "",
               2 * widest_mm <= kMostRampWidth_mm
                   ? "give a ramp_width of two voxels or more, " + two_text + " mm"
                   : "a ramp takes two voxels and at most " + number_text(kMostRampWidth_mm) +
                         " mm; give method = \"union-gaussian\""};
}

double most_force_N(const TissueSettings& tissue, double sigma_mm, const GridGeometry& grid) {
  return tissue.stiffness_N_per_mm * ramp_mm(sigma_mm, grid);
}

}  // namespace palpate
