#include <algorithm>
#include <cmath>

#include "palpate/contact/haptics.h"

namespace palpate {

Vector<Patient> viscous_force(const Tissue& tissue, const Vector<Patient>& velocity_mm_s, double inside,
                              double max_N_s_per_mm) {
  const double viscosity = std::min(tissue.viscosity_N_s_per_mm, max_N_s_per_mm);
  return velocity_mm_s * (-viscosity * std::clamp(inside, 0.0, 1.0));
}

Vector<Patient> pseudo_friction(const Tissue& tissue, const Vector<Patient>& velocity_mm_s,
                                const Vector<Patient>& normal_force_N, double max_N_s_per_mm) {
  const Vector<Patient> n = normal_force_N.normalized();
  const Vector<Patient> along_surface = velocity_mm_s - n * n.dot(velocity_mm_s);
  const double speed = along_surface.norm();
  if (speed == 0) return {};
  const double cap = std::min(tissue.friction_max_N, tissue.friction * normal_force_N.norm());
  const double magnitude =
      std::min(std::min(tissue.friction_damping_N_s_per_mm, max_N_s_per_mm) * speed, cap);
  return along_surface * (-magnitude / speed);
}

}  // namespace palpate
