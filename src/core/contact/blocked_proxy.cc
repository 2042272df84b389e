#include "contact/blocked_proxy.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate {

std::optional<BlockingContact> blocking_contact(PairSet& pairs, const Point<Patient>& proxy,
                                                const Point<Patient>& tip) {
  std::size_t nearest = 0;
  double min_mm = std::numeric_limits<double>::infinity(), deepest_mm = 0;
  for (std::size_t n = 0; n < pairs.count(); ++n) {
    deepest_mm = std::max(deepest_mm, -pairs.clearance(n, tip));
    const double clearance_mm = pairs.clearance(n, proxy);
    if (clearance_mm < min_mm) nearest = n;
    min_mm = std::min(min_mm, clearance_mm);
  }
  if (min_mm > kProxySettings.skin_mm || deepest_mm <= 0) return std::nullopt;
  const Vector<Patient> away = proxy - tip;
  return BlockingContact{nearest, away.normalized(), std::min(away.norm(), deepest_mm)};
}

SearchDirections::SearchDirections(const Vector<Patient>& to_tip)
    : ahead_(to_tip.normalized().eigen()), right_(ahead_.unitOrthogonal()), up_(ahead_.cross(right_)) {}

Eigen::Vector3d SearchDirections::direction(int cone, int n) const {
  constexpr double kBetween_rad = 2 * std::numbers::pi / kProxySettings.search_directions;
  // successive cones are rotated by half of the angle between directions
  const double lateral = cone * kProxySettings.search_cone_rad,
               around = (n + 0.5 * (cone & 1)) * kBetween_rad;
  return std::cos(lateral) * ahead_ +
         std::sin(lateral) * (std::cos(around) * right_ + std::sin(around) * up_);
}

}  // namespace palpate
