#include "palpate/model/preparing.h"

namespace palpate {

Result<Ramps> Preparing::ramps(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                               const RampOptions& options, const Progress& progress) const {
  return prepare_ramps(labels, structures, options, progress);
}

Result<std::vector<std::pair<LabelId, LabelId>>> Preparing::touching_pairs(
    const Bricks<LabelId>& labels, const std::vector<LabelId>& structures, const Progress& progress) const {
  return palpate::touching_pairs(labels, structures, 0, progress);
}

Result<std::vector<std::shared_ptr<const Surface>>> Preparing::outer_surfaces(
    const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
    const SurfaceOptions& options, const Progress& progress) const {
  return prepare_outer_surfaces(labels, groups, options, progress);
}

}  // namespace palpate
