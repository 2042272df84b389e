#include "palpate/model/model_preparation.h"

#include <algorithm>
#include <set>

namespace palpate {

Result<Ramps> ModelPreparation::ramps(const Bricks<LabelId>& labels,
                                      const std::vector<RampStructure>& structures,
                                      const RampOptions& options, const Progress& progress) const {
  return prepare_ramps(labels, structures, options, progress);
}

Result<std::vector<std::pair<LabelId, LabelId>>> ModelPreparation::touching_pairs(
    const Bricks<LabelId>& labels, const std::vector<LabelId>& structures, const Progress& progress) const {
  return palpate::touching_pairs(labels, structures, 0, progress);
}

Result<std::vector<std::shared_ptr<const Surface>>> ModelPreparation::outer_surfaces(
    const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
    const SurfaceOptions& options, const Progress& progress) const {
  std::vector<std::shared_ptr<const Surface>> surfaces(groups.size());
  const std::vector<std::vector<std::size_t>> batches = disjoint_batches(groups);
  for (const std::vector<std::size_t>& batch : batches) {
    std::vector<std::vector<LabelId>> together;
    for (const std::size_t index : batch) together.push_back(groups[index]);
    auto prepared = prepare_outer_surfaces(labels, together, options, progress);
    if (!prepared) return prepared.error();
    for (std::size_t n = 0; n < batch.size(); ++n) surfaces[batch[n]] = std::move((*prepared)[n]);
  }
  return surfaces;
}

std::vector<std::vector<std::size_t>> disjoint_batches(const std::vector<std::vector<LabelId>>& groups) {
  std::vector<std::vector<std::size_t>> batches;
  std::vector<std::set<LabelId>> used;  // labels used by each batch
  for (std::size_t index = 0; index < groups.size(); ++index) {
    const std::vector<LabelId>& group = groups[index];
    const auto has_room = [&](const std::set<LabelId>& labels) {
      return std::none_of(group.begin(), group.end(), [&](LabelId label) { return labels.count(label) > 0; });
    };
    const auto batch =
        static_cast<std::size_t>(std::find_if(used.begin(), used.end(), has_room) - used.begin());
    if (batch == batches.size()) {
      batches.emplace_back();
      used.emplace_back();
    }
    batches[batch].push_back(index);
    used[batch].insert(group.begin(), group.end());
  }
  return batches;
}

}  // namespace palpate
