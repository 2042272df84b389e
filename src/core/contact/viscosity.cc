#include <algorithm>

#include "palpate/contact/model.h"

namespace palpate {

Vector<Patient> viscous_force(const Tissue& tissue, const Vector<Patient>& velocity_mm_s, double inside,
                              double max_N_s_per_mm) {
  const double viscosity = std::min(tissue.viscosity_N_s_per_mm, max_N_s_per_mm);
  return velocity_mm_s * (-viscosity * std::clamp(inside, 0.0, 1.0));
}

}  // namespace palpate
