#include "palpate/contact/strain_stiffening.h"

#include <algorithm>
#include <cmath>

#include "palpate/base/cube_root.h"
#include "palpate/contact/contact_settings.h"

namespace palpate {

StiffenedContact stiffened_contact(double stiffening, double stored_mJ, double modulus_N_per_mm2,
                                   double radius_mm) {
  const double radius = std::max(radius_mm, kSoftTissueSettings.min_radius_mm);
  const double unit_mJ = (8.0 / 15) * modulus_N_per_mm2 * radius * radius * radius;
  const double more = kSoftTissueSettings.stiffening_factor * std::sqrt(stiffening * std::sqrt(stiffening)) *
                      cube_root(stored_mJ / unit_mJ);
  return {1 + more, stored_mJ > 0 ? more / (3 * stored_mJ) : 0, stored_mJ * (1 + 0.75 * more)};
}

}  // namespace palpate
