#include "palpate/tissue/displayed_law.h"

namespace palpate {

Model displayed_under_law(const Model& model, TissueLaw law) {
  Model displayed = model;
  displayed.tissue_law = law;
  displayed.relaxation_times = {};
  if (!is_elastic(law)) return displayed;
  for (const Tissue& tissue : displayed.tissues)
    // models never have more relaxation times than the capacity
    if (tissue.elastic && tissue.touchable && !displayed.relaxation_times.add(tissue.relaxation)) {
      displayed.relaxation_times = {};
      break;
    }
  return displayed;
}

}  // namespace palpate
