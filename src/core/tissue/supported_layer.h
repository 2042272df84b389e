#pragma once

#include <optional>
#include <span>

#include "palpate/geometry/geometry.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// Layer of one soft material on a rigid base.
struct SupportedLayer {
  double thickness_mm = 0;
  LabelId label = 0;  ///< Label at which the first ray enters
  ElasticMaterial material;
};

/// Layer under a contact, measured through the voxels on rays into the tissue: one in the middle of the
/// contact and eight on its circle. The thickness is their mean. None where a ray meets no rigid structure
/// within `max_mm`, a cavity, or material whose Young's modulus differs by more than a quarter.
/// @param labels     labels and what was removed from them
/// @param at         middle of the contact on the surface
/// @param outward    unit normal of the surface
/// @param circle_mm  radius of the circle; above 0
/// @param max_mm     greatest thickness of interest; above 0
std::optional<SupportedLayer> supported_layer(const CarvedLabels& labels,
                                              std::span<const ElasticMaterial> by_label,
                                              const Point<Patient>& at, const Vector<Patient>& outward,
                                              double circle_mm, double max_mm);

/// Mean of 1 / t over nine rays into the tissue, with t the distance to the first rigid structure: one in the
/// middle, and eight beside it at half its t, so that a narrow structure counts in part. A ray that meets a
/// cavity, the end of the volume or no rigid structure between `min_mm` and `max_mm` counts as 0. Soft
/// structures are passed, whatever their modulus.
/// @param at       contact point on the surface
/// @param outward  unit normal of the surface
double mean_inverse_base_depth_per_mm(const CarvedLabels& labels, std::span<const ElasticMaterial> by_label,
                                      const Point<Patient>& at, const Vector<Patient>& outward, double min_mm,
                                      double max_mm);

}  // namespace palpate
