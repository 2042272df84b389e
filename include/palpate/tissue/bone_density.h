#pragma once

#include <cstdint>
#include <memory>

#include "palpate/contact/model.h"

namespace palpate {

/// Ratio of the specific cutting energy of bone to that of dense cortical bone, from a calibrated CT:
///
///     clamp(HU / full_HU, 0.1, 1.25)^2
///
/// Apparent density is proportional to the attenuation above that of water within the error of such
/// calibrations (Rho et al. 1995), and the strength of bone, cortical and trabecular, to the square of its
/// density (Carter and Hayes 1977). A specific cutting energy has the dimension of a strength
/// (docs/decisions/0094-density-of-bone.md).
/// @param HU       attenuation; NaN, outside the scan: 1 is returned
/// @param full_HU  attenuation at which the ratio is 1; above 0
double density_ratio(double HU, double full_HU);

/// Value of Model::density_ratios for the ratio 1.
inline constexpr std::uint16_t kDensityRatioOne = 10'000;

/// Model::density_ratios: density_ratio() of the voxels of touchable rigid tissue, i.e. without elastic
/// constants. A voxel of no touchable tissue next to it has the mean of its neighbours, because a surface
/// between voxels may reach into it; every other voxel has the ratio 1.
/// @return null if Model::full_density_HU is 0 or there is no scan
std::shared_ptr<const Bricks<std::uint16_t>> density_ratios_of(const Model& model);

/// Ratio at a voxel; 1 outside the grid.
/// @param ratios  may be null: 1
inline double density_ratio_at(const Bricks<std::uint16_t>* ratios, int i, int j, int k) {
  return ratios == nullptr ? 1 : ratios->anywhere(i, j, k) / double{kDensityRatioOne};
}

}  // namespace palpate
