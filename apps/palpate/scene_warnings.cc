#include "scene_warnings.h"

#include <algorithm>
#include <cstdio>
#include <string>

#include "palpate/base/printable.h"
#include "palpate/scene/tissue_presets.h"

namespace palpate::app {

void warn_if_nothing_deforms(const Scene& scene, Console& console) {
  if (scene.deformation.law == TissueLaw::kLayers) return;
  if (std::none_of(scene.tissues.begin(), scene.tissues.end(),
                   [](const TissueSettings& tissue) { return tissue.touchable && tissue.elastic; }))
    console.warn()(
        "no tissue in this scene yields: give a touchable tissue a youngs_modulus, or a preset that has one");
}

void warn_of_ignored_stiffness(const Scene& scene, Console& console) {
  if (!is_elastic(scene.deformation.law)) return;
  for (const TissueSettings& tissue : scene.tissues) {
    if (!tissue.touchable || !tissue.elastic) continue;
    const TissuePreset* preset = find_preset(tissue.preset);
    if (preset == nullptr || !preset->values.elastic ||
        tissue.stiffness_N_per_mm == preset->values.stiffness_N_per_mm ||
        tissue.elastic->youngs_modulus_kPa != preset->values.elastic->youngs_modulus_kPa)
      continue;
    char modulus[32];
    std::snprintf(modulus, sizeof modulus, "%g", tissue.elastic->youngs_modulus_kPa);
    console.warn()("the stiffness of " + printable_name(tissue.name) +
                   " has no effect, because it yields: its youngs_modulus (" + modulus +
                   " kPa) is used; change that, or write law = \"layers\" under [yielding]");
  }
}

}  // namespace palpate::app
