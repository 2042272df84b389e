#include "palpate/tissue/displayed_law.h"

namespace palpate {

Model displayed_under_law(const Model& model, TissueLaw law) {
  Model seen = model;
  seen.tissue_law = law;
  seen.relaxation_times = {};
  if (!is_elastic(law)) return seen;
  for (const Tissue& tissue : seen.tissues)
    // models never have more relaxation times than the capacity
    if (tissue.elastic && tissue.felt && !seen.relaxation_times.add(tissue.relaxation)) {
      seen.relaxation_times = {};
      break;
    }
  return seen;
}

}  // namespace palpate
