#pragma once

#include <span>
#include <string>

#include "palpate/contact/model.h"
#include "palpate/rendering/rendering.h"
#include "palpate/tissue/displaced_tissue.h"

/// Strain of tissue as a colour overlay on a section; the same scale as in web/src/drawing/strain.ts.
namespace palpate::report {

/// Linear colour scale up to kMaxStrain, at which it saturates. Below kMinStrain the overlay fades out,
/// and a contact that strains nothing above it has no strain picture.
inline constexpr double kMaxStrain = 0.25, kMinStrain = 0.02;

struct StrainMap {
  Overlay picture;
  double most = 0;  ///< Maximum over the visible pixels; infinite: an element is inverted
};
/// Equivalent strain (DisplacedTissue::strain) of deformable tissue in each pixel of a section; transparent
/// elsewhere and where it is unknown.
/// @param labels  labels of the section's pixels, row by row, in the deformed state
StrainMap strain_map(const Model& model, const DisplacedTissue& deformed, const TissueDisplacement& moved,
                     const SectionPlane& plane, std::span<const LabelId> labels);

/// Colour scale as SVG, with numbers.
std::string strain_scale_svg();

}  // namespace palpate::report
