#include "palpate/model/ramp_structures.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// all tissues that support a tissue, directly or through others
std::vector<bool> supports_of(const Model& model, int tissue) {
  std::vector<bool> supports(model.tissues.size(), false);
  std::vector<int> left{tissue};
  while (!left.empty()) {
    const int next = left.back();
    left.pop_back();
    for (const int support : model.tissues[static_cast<std::size_t>(next)].rests_on) {
      if (supports[static_cast<std::size_t>(support)]) continue;
      supports[static_cast<std::size_t>(support)] = true;
      left.push_back(support);
    }
  }
  return supports;
}

}  // namespace

std::vector<RampStructure> ramp_structures(const Model& model, const Bricks<LabelId>& labels) {
  const std::vector<std::size_t> present = label_counts(labels);
  std::vector<RampStructure> structures;
  for (std::size_t id = 1; id < model.tissue_of_label.size(); ++id) {
    const auto label = static_cast<LabelId>(id);
    if (present[id] == 0 || !model.is_touchable(label)) continue;
    const std::vector<bool> supports = supports_of(model, model.tissue_of_label[id]);
    RampStructure structure{label, model.tissue_of(label)->stiffness_N_per_mm, {}};
    for (std::size_t other = 1; other < model.tissue_of_label.size(); ++other)
      if (present[other] > 0 && model.is_touchable(static_cast<LabelId>(other)) &&
          supports[static_cast<std::size_t>(model.tissue_of_label[other])])
        structure.rests_on.push_back(static_cast<LabelId>(other));
    structures.push_back(std::move(structure));
  }
  return structures;
}

std::uint8_t weight_of(const Tissue& tissue, double stiffest_N_per_mm) {
  return static_cast<std::uint8_t>(
      std::clamp<long>(std::lround(255 * tissue.stiffness_N_per_mm / stiffest_N_per_mm), 1, 255));
}

float level_of(const Tissue& tissue, std::uint8_t weight) {
  return tissue.touchable ? static_cast<float>(weight) / 255.f : 0.f;
}

}  // namespace palpate
