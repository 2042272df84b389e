#pragma once

#include <span>
#include <string>

#include "palpate/haptics/haptics.h"
#include "palpate/rendering/rendering.h"
#include "palpate/tissue/displaced_tissue.h"

/// How strained tissue is, as colours over a section: the page's own scale (web/src/strain.ts).
namespace palpate::report {

/// From none to kMaxStrain, evenly; what is strained more looks the same. What is strained less than
/// kMinStrain is covered the less, and a contact that strains nothing so much has no strain picture.
inline constexpr double kMaxStrain = 0.25, kMinStrain = 0.02;

struct StrainMap {
  Overlay picture;
  double most = 0;  ///< of what is seen; infinite: something is turned inside out
};
/// The equivalent strain (DisplacedTissue::strain) of what yields in each pixel of a section; nothing over
/// what does not, and where it is not known.
/// @param labels  that are seen in the section, row by row, tissue where it has gone to
StrainMap strain_map(const Model& model, const DisplacedTissue& yielded, const TissueDisplacement& moved,
                     const SectionPlane& plane, std::span<const LabelId> labels);

/// The scale, as SVG with its figures.
std::string strain_scale_svg();

}  // namespace palpate::report
