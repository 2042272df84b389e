#include "contact/constraint_gathering.h"

#include <algorithm>
#include <limits>

namespace palpate {
namespace {

// Displacement that reaches no surface. It ends half a skin before the nearest one, so that the next substep
// gathers it as a constraint. Clearances are divided by the slope of the distance field.
double free_distance_mm(PairSet& pairs, const Point<Patient>& proxy) {
  double free_mm = std::numeric_limits<double>::infinity();
  for (std::size_t n = 0; n < pairs.count(); ++n) {
    // a surface within the skin that has no normal there yields no constraint; half of its clearance is then
    // free
    const double clearance_mm = pairs.clearance(n, proxy);
    const double free_of_pair_mm =
        std::max({0.0, clearance_mm - 0.5 * kProxySettings.skin_mm, 0.5 * clearance_mm});
    free_mm = std::min(free_mm, free_of_pair_mm / pairs[n].surface->max_gradient());
  }
  return free_mm;
}

}  // namespace

double gather_constraints(PairSet& pairs, const Point<Patient>& proxy, ContactConstraints& constraints) {
  constraints.clear();
  for (std::size_t n = 0; n < pairs.count(); ++n) {
    const double clearance_mm = pairs.clearance(n, proxy, kProxySettings.skin_mm);
    if (clearance_mm <= kProxySettings.skin_mm) constraints.add(pairs[n], pairs.step(n), proxy, clearance_mm);
  }
  return constraints.count() == 0 ? free_distance_mm(pairs, proxy) : std::numeric_limits<double>::infinity();
}

bool add_penetrated(PairSet& pairs, const Point<Patient>& end, ContactConstraints& constraints) {
  bool any = false;
  for (std::size_t n = 0; n < pairs.count(); ++n) {
    const double clearance_mm = pairs.clearance(n, end, -kProxySettings.substep_penetration_mm);
    if (clearance_mm >= -kProxySettings.substep_penetration_mm) continue;
    constraints.add(pairs[n], pairs.step(n), end, clearance_mm);
    any = true;
  }
  return any;
}

bool penetrates_any(PairSet& pairs, const Point<Patient>& at) {
  for (std::size_t n = 0; n < pairs.count(); ++n)
    if (pairs.clearance(n, at, -kProxySettings.substep_penetration_mm) <
        -kProxySettings.substep_penetration_mm)
      return true;
  return false;
}

}  // namespace palpate
