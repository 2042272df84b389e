#include "palpate/tissue/displayed_law.h"

namespace palpate {

Model displayed_under_law(const Model& model, TissueLaw law) {
  Model observed = model;
  observed.tissue_law = law;
  observed.relaxation_times = {};
  if (!is_elastic(law)) return observed;
  for (const Tissue& tissue : observed.tissues)
    // models never have more relaxation times than the capacity
    if (tissue.elastic && tissue.touchable && !observed.relaxation_times.add(tissue.relaxation)) {
      observed.relaxation_times = {};
      break;
    }
  return observed;
}

}  // namespace palpate
